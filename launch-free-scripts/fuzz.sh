#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

# What read_options does not know is taken out of its arguments.
limit=(-max_total_time=60)
seed=()
others=()
while [ $# -gt 0 ]; do
  case $1 in
    --seconds | --runs | --seed)
      if ! [[ ${2-} =~ ^[1-9][0-9]*$ ]]; then
        echo "$(basename "$0"): $1 needs a number above 0" >&2
        exit 2
      fi
      case $1 in
        --seconds) limit=("-max_total_time=$2") ;;
        --runs) limit=("-runs=$2") ;;
        --seed) seed=("-seed=$2") ;;
      esac
      shift 2
      ;;
    *)
      others+=("$1")
      shift
      ;;
  esac
done
read_options "Installs what is missing, builds the fuzzers in build/sanitizers and runs each of them, as many at a time as there are cores.
  --seconds N  for each of them [60]
  --runs N     executions of each of them instead
  --seed N     from the kept corpus alone, with this seed: the same inputs in the same order, as far as time goes" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" "${clang_packages[@]}"
cd "$root"
cmake --preset sanitizers
cmake --build build/sanitizers -j "$jobs" --target fuzzers

# What the fuzzers find new stays in build/sanitizers/corpus; cases worth keeping go to tests/fuzz/corpus by hand.
cd build/sanitizers
[ ${#seed[@]} -eq 0 ] || rm -rf corpus
add_to_corpus() {
  mkdir -p "corpus/$1"
  cp "${@:2}" "corpus/$1"
}
add_to_corpus urdf "$root"/urdf/*.urdf
add_to_corpus joint_convention "$root"/urdf/*.json

# One target; its log says the rest. A calibration takes seconds under the sanitizers, and the machine may have other
# work.
fuzz() {
  local target=$1 length=256
  case $target in
    urdf) length=12000 ;;
    joint_convention | json_inputs | programs) length=512 ;;
  esac
  mkdir -p "corpus/$target"
  "tests/fuzz/${target}_fuzzer" -rss_limit_mb=4096 -timeout=120 "-max_len=$length" -print_final_stats=1 \
    -close_fd_mask=1 "-artifact_prefix=$PWD/$target-" "${limit[@]}" "${seed[@]}" \
    "corpus/$target" "$root/tests/fuzz/corpus/$target" >"$target.log" 2>&1
}

targets=()
for program in tests/fuzz/*_fuzzer; do
  targets+=("$(basename "$program" _fuzzer)")
done
failed=()
for ((first = 0; first < ${#targets[@]}; first += jobs)); do
  batch=("${targets[@]:first:jobs}")
  echo "fuzzing ${batch[*]}"
  pids=()
  for target in "${batch[@]}"; do
    fuzz "$target" &
    pids+=($!)
  done
  for i in "${!pids[@]}"; do
    wait "${pids[i]}" || failed+=("${batch[i]}")
  done
done

printf '%-20s %12s %12s\n' target executions per_second
for target in "${targets[@]}"; do
  awk -v target="$target" '/number_of_executed_units/ { n = $2 } /average_exec_per_sec/ { speed = $2 }
    END { printf "%-20s %12d %12d\n", target, n, speed }' "$target.log"
done
for target in "${failed[@]}"; do
  grep -hE '^(==|SUMMARY|broken promise|.*ERROR)' "$target.log" || true
  echo "$target: failed, see $PWD/$target.log and the input $PWD/$target-*" >&2
done
[ ${#failed[@]} -eq 0 ]
