# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Time per update against the site's side, and against the voxel size. gnuplot -e "folder='DIR'"
set terminal pngcairo size 1000,700 font "DejaVu Sans,12" background "white"
set datafile separator ","
set datafile missing NaN
set key outside right top
set logscale xy
set grid linewidth 0.5
set ylabel "time per update, µs"

set output folder . "/site.png"
set title "An update costs what its stroke costs, whatever the site (5 cm voxels)"
set xlabel "side of the site, m"
site = folder . "/site.csv"
names = "soilvdb_hills soilvdb_plane openvdb_stock"
plot for [i=1:words(names)] site skip 1 using ((strcol(1) eq word(names, i)) ? $2 : NaN):4 \
       with linespoints linewidth 2 pointtype 7 title word(names, i) noenhanced

set output folder . "/voxels.png"
set title "Against voxel size, bucket width and threads"
set xlabel "voxel size, m"
sizes = folder . "/sizes.csv"
plot for [threads=1:2] for [w in "0.6 1.2 2.4 4.8"] sizes skip 1 \
       using (($3 == threads && abs($2 - w) < 1e-6) ? $1 : NaN):4 with linespoints linewidth 2 \
       dashtype threads title sprintf("bucket %s m, %d thread%s", w, threads, threads > 1 ? "s" : "")
