# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Error of one drag at any voxel size, place, slope and scale. gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set datafile missing NaN
set output folder . "/stability.png"
set title "Volume error of one drag, voxel 1/24 of the bucket's width unless named"
set style data points
set xtics rotate by -60
set ylabel "relative error, %"
set grid linewidth 0.5
file = folder . "/stability.csv"
plot for [k in "coordinates slope scale"] file skip 1 \
       using (column(0)):((strcol(1) eq k) ? 100 * $3 : NaN):xtic(((strcol(1) eq k) ? strcol(2) : "")) \
       pointtype 7 pointsize 1.5 title k, \
     file skip 1 using (column(0)):((strcol(1) eq "voxel size") ? 100 * $3 : NaN):xtic(((strcol(1) eq "voxel size") ? strcol(2) : "")) \
       pointtype 7 pointsize 1.5 title "voxel size"
