# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Outlines of a heap at a third of a cone's height. gnuplot -e "folder='DIR'"
set terminal pngcairo size 800,800 font "DejaVu Sans,12" background "white"
set datafile separator ","
set output folder . "/outlines.png"
set title "Outline of a heap at a third of its height, repose 35 degrees, radius 24 voxels"
set size square
set xrange [-26:26]
set yrange [-26:26]
set xlabel "voxels"
set ylabel "voxels"
set grid linewidth 0.5
set key below
x(r) = r * cos(column(1) * pi / 180)
y(r) = r * sin(column(1) * pi / 180)
plot folder . "/outlines.csv" skip 1 using (x($2)):(y($2)) with lines linewidth 6 linecolor rgb "#cccccc" title "a circle", \
     "" skip 1 using (x($3)):(y($3)) with lines linewidth 2 linecolor rgb "#d62728" title "soilvdb", \
     "" skip 1 using (x($4)):(y($4)) with lines linewidth 1.5 linecolor rgb "#1f77b4" title "four neighbours", \
     "" skip 1 using (x($5)):(y($5)) with lines linewidth 1.5 linecolor rgb "#2ca02c" title "eight neighbours"
