# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Completion of soilvdb's command lines in bash: it asks the program's own help. Elsewhere than for
# commands, options and values of which there is a list, names of files are completed.

_soilvdb() {   # PROGRAM WORD PREVIOUS
  local words help
  if ((COMP_CWORD == 1)); then
    help=$("$1" --help 2>/dev/null)
    words=$(sed -n '/^Subcommands:$/,/^$/s/^  \([^ ]*\).*/\1/p' <<<"$help")
    [[ $2 == -* ]] && words='--help --version'
  else
    help=$("$1" "${COMP_WORDS[1]}" --help 2>/dev/null)
    if [[ $2 == -* ]]; then
      words=$(sed -n 's/^  \(-h,\)\{0,1\}\(--[a-z-]*\).*/\2/p' <<<"$help")
    else   # --view plan|perspective
      words=$(sed -n "s/^  ${3//[^a-z-]/} \([a-z]*|[a-z|]*\).*/\1/p" <<<"$help" | tr '|' '\n')
    fi
  fi
  # shellcheck disable=SC2207  # words, of which none has a space
  COMPREPLY=($(compgen -W "$words" -- "$2"))
}

complete -o default -F _soilvdb soilvdb
