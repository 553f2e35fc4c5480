# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Where soil comes to rest, by us and by rules between neighbours, and how long updates take.
# gnuplot -e "folder='DIR'"
set datafile separator ","
set grid linewidth 0.5 linecolor rgb "#dddddd"
ours = "#d62728"
four = "#1f77b4"
eight = "#2ca02c"

set terminal pngcairo size 820,900 font "DejaVu Sans,12" background "white"
set output folder . "/outlines.png"
set title "One heap, three methods: outline at a third of its height\n{/*0.85 repose 35 degrees, radius 24 voxels, poured in 100 parts}"
set size ratio -1
set xrange [-24:24]
set yrange [-24:24]
set xlabel "voxels"
set ylabel "voxels"
set key below
x(r) = r * cos(column(1) * pi / 180)
y(r) = r * sin(column(1) * pi / 180)
plot folder . "/outlines.csv" skip 1 using (x($2)):(y($2)) with lines linewidth 7 linecolor rgb "#cccccc" title "a circle: the truth", \
     "" skip 1 using (x($3)):(y($3)) with lines linewidth 2 linecolor rgb ours title "soilvdb", \
     "" skip 1 using (x($4)):(y($4)) with lines linewidth 2 linecolor rgb four title "rule between four neighbours", \
     "" skip 1 using (x($5)):(y($5)) with lines linewidth 2 linecolor rgb eight title "rule between eight neighbours"

set terminal pngcairo size 900,560 font "DejaVu Sans,12" background "white"
set size noratio
set autoscale
set key below
set format y "%g"

set output folder . "/cone_error.png"
set title "A cone as it grows: how far heights are from the truth"
set xlabel "poured, m^3"
set ylabel "root mean square, voxels"
set logscale y
set xrange [0:*]
set yrange [0.003:3]
plot folder . "/cone_error.csv" skip 1 using 1:2 with lines linewidth 2 linecolor rgb ours title "soilvdb", \
     "" skip 1 using 1:3 with lines linewidth 2 linecolor rgb four title "rule between four neighbours", \
     "" skip 1 using 1:4 with lines linewidth 2 linecolor rgb eight title "rule between eight neighbours"

set output folder . "/wall_error.png"
set title "A wall 1 m high at 30 degrees to the grid collapses: how far heights are from the truth\n{/*0.85 96 x 96 columns of 5 cm, one thread}"
set xlabel "computing time, ms"
set logscale x
set xrange [0.1:300]
set yrange [0.003:10]
set format x "%g"
who(name, column_) = strcol(1) eq name ? column(column_) : NaN
plot folder . "/wall_error.csv" skip 1 using (who("soilvdb", 2)):3 with points pointtype 7 pointsize 2.5 linecolor rgb ours title "soilvdb, at rest", \
     "" skip 1 using (who("four", 2)):3 with lines linewidth 2 linecolor rgb four title "rule between four neighbours, over and over again until nothing slides", \
     "" skip 1 using (who("eight", 2)):3 with lines linewidth 2 linecolor rgb eight title "rule between eight neighbours, the same"

set output folder . "/cycle_updates.png"
set title "An excavator's cycles at 100 Hz, 5 cm, soil that falls, piles up and slides: each update"
set xlabel "time in the cycle, s"
set ylabel "ms"
unset logscale x
set xrange [0:15]
set yrange [0.001:100]
set arrow 1 from 0,5 to 15,5 nohead dashtype 2 linecolor rgb "#888888"
set label 1 "5 ms: 99 of 100 updates" at 9.4,5 center offset 0,0.6 textcolor rgb "#666666"
set arrow 2 from 0,15 to 15,15 nohead dashtype 2 linecolor rgb "#888888"
set label 2 "15 ms: every one" at 9.4,15 center offset 0,0.6 textcolor rgb "#666666"
set label 3 "it digs" at 3,50 center
set label 4 "curls, lifts" at 6.5,50 center
set label 5 "swings" at 9.5,50 center
set label 6 "tips" at 12,50 center
set label 7 "back" at 14,50 center
plot folder . "/cycle_updates.csv" skip 1 using 2:($3 / 1000) with points pointtype 7 pointsize 0.35 linecolor rgb ours notitle
