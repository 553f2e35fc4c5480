#!/bin/bash
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# What bash offers on command lines of the program that is named, and that the program takes it.
set -eu
program=$1
source "$(dirname "$0")/../tools/packaging/completion.bash"

expect() {   # WORDS... = OFFERED...
  local line="$*" word previous
  COMP_WORDS=()
  while [[ $1 != = ]]; do
    COMP_WORDS+=("$1")
    shift
  done
  shift
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  word=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]}
  _soilvdb "$program" "$word" "$previous" || true   # nothing to offer
  [[ "${COMPREPLY[*]}" == "$*" ]] || {
    echo "$line: offered were ${COMPREPLY[*]}"
    exit 1
  }
}

expect soilvdb '' = run resume serve verify info export diff
expect soilvdb re = resume
expect soilvdb - = --help --version
expect soilvdb run --no = --no-mesh --no-snapshots
expect soilvdb export a.vdb --to x.png -- = --help --to --region --view --occupancy
expect soilvdb export a.vdb --view '' = plan perspective
expect soilvdb export a.vdb --to '' =
expect soilvdb run '' =
expect soilvdb nonsense -- =

# Every option that is offered the program knows, and it offers as many as its help has.
for command in run resume serve verify info export diff; do
  COMP_WORDS=(soilvdb "$command" --) COMP_CWORD=2
  _soilvdb "$program" -- "$command"
  [[ ${#COMPREPLY[@]} == $("$program" $command --help | grep -c '^  -') ]]
  for option in "${COMPREPLY[@]}"; do
    [[ $("$program" $command "$option" 2>&1) != *"no option"* ]]
  done
done
