# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Error of one drag at any voxel size, place, slope and scale. gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set datafile missing NaN
set output folder . "/stability.png"
set title "Volume error of one drag, 2.5 cm voxels where not named"
set xtics rotate by -60
set ylabel "relative error, %"
set grid linewidth 0.5
set offsets 0.5, 0.5, 0, 0
set key off
plot folder . "/drags.csv" skip 1 using (column(0)):(100 * $2):xtic(1) pointtype 7 pointsize 1.5
