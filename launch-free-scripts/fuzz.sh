#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# --seconds and --runs are each target's; what read_options does not know is taken out of its arguments.
limit=(-max_total_time=60)
others=()
while [ $# -gt 0 ]; do
  case $1 in
    --seconds | --runs)
      if ! [[ ${2-} =~ ^[1-9][0-9]*$ ]]; then
        echo "$(basename "$0"): $1 needs a number above 0" >&2
        exit 2
      fi
      [ "$1" = --seconds ] && limit=("-max_total_time=$2") || limit=("-runs=$2")
      shift 2
      ;;
    *)
      others+=("$1")
      shift
      ;;
  esac
done
read_options "Installs what is missing, builds the fuzzers in build/fuzz and runs each of them.
  --seconds N  for each of them [60]
  --runs N     executions of each of them instead" "${others[@]}"
install_missing "${build_packages[@]}" clang libclang-rt-14-dev
configure_and_build fuzz

# What the fuzzers find new stays in build/fuzz/corpus; cases worth keeping go to tests/fuzz/corpus by hand.
cd "$root/build/fuzz"
seed() {
  mkdir -p "corpus/$1"
  cp "${@:2}" "corpus/$1"
}
seed urdf "$root"/urdf/*.urdf
seed joint_convention "$root"/urdf/*.json
echo "target executions per_second" >fuzz.txt
for program in tests/fuzz/*_fuzzer; do
  target=$(basename "$program" _fuzzer)
  mkdir -p "corpus/$target"
  echo "== $target"
  # A calibration takes seconds under the sanitizers, and the machine may have other work.
  status=0
  "$program" -rss_limit_mb=4096 -timeout=120 -max_len=4096 -print_final_stats=1 -close_fd_mask=1 \
    "-artifact_prefix=$PWD/$target-" "${limit[@]}" "corpus/$target" "$root/tests/fuzz/corpus/$target" \
    >"$target.log" 2>&1 || status=$?
  grep -E '^(stat::|==|SUMMARY|broken promise|.*ERROR)' "$target.log" || true
  [ "$status" -eq 0 ] || { echo "$target: failed, see $PWD/$target.log" >&2; exit 1; }
  awk -v target="$target" '/number_of_executed_units/ { n = $2 } /average_exec_per_sec/ { speed = $2 }
    END { print target, n, speed }' "$target.log" >>fuzz.txt
done
column -t fuzz.txt
