#!/bin/sh
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Digs in a world of large coordinates and has what was recorded read by other people's readers.
#   run.sh PROGRAM WORK     exit status 77 where those can't be had
set -eu
program=$1
work=$2
here=$(cd "$(dirname "$0")" && pwd)
mkdir -p "$work"
skip() {
  echo "skipped: $1"
  exit 77
}
command -v node >/dev/null || skip "there is no node to run the readers"
command -v npm >/dev/null || skip "there is no npm to fetch the readers"
if ! cmp -s "$here/package-lock.json" "$work/installed-lock.json"; then
  cp "$here/package.json" "$here/package-lock.json" "$work"
  (cd "$work" && npm ci --no-audit --no-fund --ignore-scripts >npm.log 2>&1) ||
    skip "npm can't fetch the readers: $(grep -m 1 -i 'err' "$work/npm.log")"
  cp "$here/package-lock.json" "$work/installed-lock.json"
fi
cp "$here/check.mjs" "$work"
cd "$work"
rm -rf runs
mkdir runs

# A bucket that goes down, along, and up again, 20 s, at a corner of a UTM zone and 1.7e9 s.
awk 'BEGIN { print "time,x,y,z,yaw"
  for (i = 0; i <= 400; ++i) { s = i / 400
    printf "%.2f,%.6f,%.6f,%.6f,0.4\n", 1700000000 + i / 20, 500000 + 6 * s, 5400000 + 2.54 * s,
           0.1 - 2.5 * sin(3.14159265358979 * s) } }' >runs/dig.csv
cat >runs/dig.yaml <<'END'
soilvdb: 1
voxel_size: 0.05
terrain: {plane: {z: 0}}
machines:
  - {name: digger, bucket: {width: 5, height: 2.8}, motion: dig.csv}
output: {mcap: true}
END
"$program" run runs/dig.yaml --out runs/dig >/dev/null
node check.mjs runs/dig 500000 5400000

# The same in soil that resists, with its force.
sed -e 's/voxel_size: 0.05/voxel_size: 0.1/' -e 's/mcap: true/mcap: true, force: true/' -e s/dig.csv/force.csv/ runs/dig.yaml >runs/force.yaml
cp runs/dig.csv runs/force.csv
echo 'soil: {repose_angle: 0.6, density: 1800, cohesion: 100000}' >>runs/force.yaml
"$program" run runs/force.yaml --out runs/force >/dev/null 2>&1
node check.mjs runs/force 500000 5400000

# Cut off anywhere: what a kill leaves.
size=$(wc -c <runs/dig/soil.mcap)
head -c $((size * 9 / 10)) runs/dig/soil.mcap >runs/torn.part
node check.mjs runs/torn.part

# A live site that plays the same, stopped while it runs on, and gone on with.
serve() {
  rm -f runs/url runs/said
  "$program" serve "$@" --port 0 </dev/null >runs/url 2>runs/said &
  server=$!
}
until_has() {
  n=0
  until grep -qs "$1" "$2"; do
    n=$((n + 1))
    [ $n -lt 600 ] && kill -0 $server || { cat runs/said; exit 1; }
    sleep 0.1
  done
}
keep_summary() {
  node -e 'fetch(`${process.argv[1]}summary.json`).then((r) => r.text()).then(console.log)' "$1" >"$2"
}
trap 'kill $server 2>/dev/null || true' EXIT
serve runs/dig.yaml --speed 20 --out runs/live
until_has "come to its end" runs/said
keep_summary "$(cat runs/url)" runs/live_summary.json
kill -INT $server
wait $server
cp runs/live_summary.json runs/live/summary.json
node check.mjs runs/live 500000 5400000
serve runs/dig.yaml --speed 20 --out runs/live
until_has http runs/url
kill -INT $server
wait $server
cp runs/live_summary.json runs/live/summary.json
node check.mjs runs/live 500000 5400000 soil_1.mcap

# A live site that is asked for each force records those that it answers.
mkdir runs/force_live
awk -F, 'NR > 1 { printf "{\"machine\": \"digger\", \"time\": %s, \"position\": [%s, %s, %s], " \
  "\"rotation\": [0, 0, 0.19866933079506122, 0.98006657784124163], \"force\": true}\n", $1, $2, $3, $4 }' \
  runs/dig.csv >runs/states
"$program" serve runs/force.yaml --stdin --out runs/force_live --port 0 <runs/states >runs/answers 2>runs/said &
server=$!
n=0
until [ "$(wc -l <runs/answers)" -eq "$(wc -l <runs/states)" ]; do
  n=$((n + 1))
  [ $n -lt 600 ] && kill -0 $server || { cat runs/said; exit 1; }
  sleep 0.1
done
keep_summary "$(sed -n 's/.*serving at //p' runs/said)" runs/summary.json
kill -INT $server
wait $server
mv runs/states runs/answers runs/summary.json runs/force_live
node check.mjs runs/force_live 500000 5400000
