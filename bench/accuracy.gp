# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Error over time per update, and over the number of updates. gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set key outside right top
set logscale xy
set format y "%g %%"
set grid linewidth 0.5
engines = "soilvdb paper openvdb_stock openvdb_csg octomap cgal"
colour(i) = word("#d62728 #1f77b4 #2ca02c #98df8a #9467bd #ff7f0e", i)
set datafile missing NaN

curves = folder . "/curves.csv"
common = 100
set output folder . "/error_over_time.png"
set title "Volume error over time per update (" . common . " updates per dig, rms over the digs)"
set xlabel "time per update, µs"
set ylabel "error of the cut volume"
paper = 0.76
plot for [i=1:words(engines)] curves skip 1 \
       using ((strcol(1) eq word(engines, i) && $2 == common) ? $5 : NaN):(100 * $4) \
       with linespoints linewidth 2 pointtype 7 linecolor rgb colour(i) title word(engines, i) noenhanced, \
     paper with lines dashtype 2 linecolor rgb "black" title "the paper: 0.76 %"

set output folder . "/error_over_updates.png"
set title "Volume error over number of updates, the same dig, 2.5 cm voxels"
set xlabel "updates"
updates = folder . "/updates.csv"
plot for [i=1:words(engines)] updates skip 1 \
       using ((strcol(1) eq word(engines, i) && abs($2 - 0.025) < 1e-6) ? $3 : NaN):(100 * $4) \
       with linespoints linewidth 2 pointtype 7 linecolor rgb colour(i) title word(engines, i) noenhanced, \
     paper with lines dashtype 2 linecolor rgb "black" title "the paper: 0.76 %"
