# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Error over time per update, and over the number of updates. gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set datafile missing NaN
set logscale xy
set format y "%g %%"
set grid linewidth 0.5
set key below maxrows 2 samplen 2 Left reverse spacing 1.2
set bmargin 6.5
set rmargin 5
set ylabel "error of the cut volume, rms over the digs"
set pointsize 1.2
engines = "soilvdb paper openvdb_stock openvdb_csg octomap cgal"
array name[6] = ["soilvdb", "the paper's method", "OpenVDB, as documented", "OpenVDB, at its best", \
                 "OctoMap", "CGAL"]
colour(i) = word("#d62728 #1f77b4 #2ca02c #98df8a #9467bd #ff7f0e", i)
set arrow from graph 0, first 0.76 to graph 1, first 0.76 nohead dashtype 2
set label "0.76 %: what the paper reports" at graph 0.99, first 0.76 right offset 0, 0.6

common = 100
set output folder . "/error_over_time.png"
set title "Error over time: " . common . " updates per dig, each line from voxels of 20 cm to 1.25 cm"
set xlabel "time per update, µs (geometric mean over the digs)"
plot for [i=1:words(engines)] folder . "/curves.csv" skip 1 \
       using ((strcol(1) eq word(engines, i) && $2 == common) ? $5 : NaN):(100 * $4) \
       with linespoints linewidth 2 pointtype 7 linecolor rgb colour(i) title name[i] noenhanced

set output folder . "/error_over_updates.png"
set title "Error over the number of updates that the same digs are split into, voxels of 2.5 cm"
set xlabel "updates per dig"
plot for [i=1:words(engines)] folder . "/updates.csv" skip 1 \
       using ((strcol(1) eq word(engines, i) && abs($2 - 0.025) < 1e-6) ? $3 : NaN):(100 * $4) \
       with linespoints linewidth 2 pointtype 7 linecolor rgb colour(i) title name[i] noenhanced
