#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# What read_options does not know goes to tests/mutation.
known=()
others=()
for option in "$@"; do
  case $option in
    --yes | -h | --help) known+=("$option") ;;
    *) others+=("$option") ;;
  esac
done
read_options "Breaks a copy of the library and of kdlcal on purpose, one place at a time, and shows which of the defects the tests
notice. Defects are drawn from src/ with a seed. Everything happens in build/mutation.
  --seed N --count N       another drawing [1, 150]; --first N: only so many of it, a sample of all sources
  --list                   the defects of tests/mutation/defects.tsv instead
  --only-survivors LOG     those again that survived according to a log (build/mutation/seed-1.jsonl)
  --defect ID...           these again, of the log
  --only RE                only where file, kind or text match
  --resume                 take from the log what was caught before
  --jobs N                 so many side by side [2]
  --least P                fail where less than P percent are caught [90, of the list 95]
  --real-data              run the suites on real data too
  --revision REV           of git, instead of the files as they are" "${known[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" python3
exec python3 "$root/tests/mutation/mutation.py" "${others[@]}"
