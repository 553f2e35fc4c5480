# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Error of one drag at any voxel size, place, slope and scale; time per stroke over a long run.
# gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set datafile missing NaN
set grid linewidth 0.5
set key off

set output folder . "/stability.png"
set title "Volume error of one drag, voxels of 2.5 cm where not named"
set xtics rotate by 60 right
set ylabel "relative error"
set format y "%.2f %%"
set offsets 0.5, 0.5, 0.02, 0.02
set xzeroaxis linewidth 1
plot folder . "/drags.csv" skip 1 using 0:(100 * $2):xtic(1) pointtype 7 pointsize 1.5

set output folder . "/creep.png"
set title "Time per stroke over a long run of random strokes that dig deeper and deeper"
set xtics norotate autojustify
set xlabel "strokes"
set ylabel "mean time per stroke, µs"
set format y "%g"
set format x "%.0f"
set rmargin 5
set offsets 0, 0, 0, 0
set yrange [0:*]
plot folder . "/creep.csv" skip 1 using 1:2 with lines linewidth 2
