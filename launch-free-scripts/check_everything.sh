#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

check_tidy() {
  "$root/launch-free-scripts/lint.sh" --yes --tidy-tests
}

# Every const method of the public headers from two threads.
check_threads() {
  cd "$root"
  cmake --preset tsan
  cmake --build build/tsan -j "$jobs" --target base_tests project_tests
  build/tsan/tests/base_tests --gtest_brief=1 --gtest_filter='Parallel*'
  build/tsan/tests/project_tests --gtest_brief=1 --gtest_filter='Threads*'
  echo "the thread sanitizer has no finding"
}

# The wings above those that CI runs under the address and undefined behaviour sanitizers.
check_sanitizers() {
  configure_and_build sanitizers -D KDL_CALIBRATION_SHARED_DATA_DIR="$data"
  run_tests sanitizers -L 'two_step|interface|noise|uncertainty|validation|screening|diagnosis|selection|calibration|results|planning|cli'
}

# Branches that only an exception takes, and those that the compiler makes in unreachable places, are not counted.
check_coverage() {
  local build=$root/build/coverage what
  install_missing gcovr
  # With a full disk the counters cannot be written either, and say so.
  configure_and_build coverage -D KDL_CALIBRATION_SHARED_DATA_DIR="$data" \
    -D KDL_CALIBRATION_TESTS_LEFT_OUT='*OnAFullDisk*'
  find "$build" -name '*.gcda' -delete
  run_tests coverage -E '^(browser|consumer)$'
  gcovr --root "$root" --filter "$root/src/" --exclude-throw-branches --exclude-unreachable-branches \
    --json "$build/coverage.json" "$build"
  for what in --branches ''; do
    gcovr --root "$root" --add-tracefile "$build/coverage.json" --sort-percentage ${what:+"$what"}
  done
  gcovr --root "$root" --add-tracefile "$build/coverage.json" --print-summary --output /dev/null
}

check_mutation() {
  "$root/launch-free-scripts/mutation.sh" --yes ${data:+--real-data}
}

check_campaigns() {
  "$root/launch-free-scripts/test.sh" --yes --campaigns ${data:+--data "$data"}
}

all=(tidy threads sanitizers coverage mutation campaigns)
read_data_option "$@"
known=()
checks=()
for word in "${others[@]}"; do
  if [[ " ${all[*]} " == *" $word "* ]]; then checks+=("$word"); else known+=("$word"); fi
done
read_options "Checks that take too long for every change, or those of them that are named:
  tidy       clang-tidy on the tests as well
  threads    the thread sanitizer
  sanitizers the address and undefined behaviour sanitizers on the wings that CI leaves out
  coverage   lines and branches that the tests reach
  mutation   drawn defects that the tests notice (mutation.sh has options of its own)
  campaigns  every test, Monte Carlo over many minutes among them
  --data DIR  real measurements" "${known[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" "${clang_packages[@]}"
for check in "${checks[@]:-${all[@]}}"; do
  "check_$check"
done
