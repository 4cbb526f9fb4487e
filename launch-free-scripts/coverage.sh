#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_data_option "$@"
read_options "Installs what is missing, builds in build/coverage, runs the tests (without the long ones, which have
short versions) and prints the coverage of src/.
Branches that only an exception takes, and those that the compiler makes in unreachable places, are not counted.
  --data DIR  real measurements" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" gcovr
# With a full disk the counters cannot be written either, and say so.
configure_and_build coverage -D KDL_CALIBRATION_SHARED_DATA_DIR="$data" -D KDL_CALIBRATION_TESTS_LEFT_OUT='*OnAFullDisk*'
find "$root/build/coverage" -name '*.gcda' -delete
run_tests coverage

build=$root/build/coverage
gcovr --root "$root" --filter "$root/src/" --exclude-throw-branches --exclude-unreachable-branches \
  --json "$build/coverage.json" "$build"
for what in --branches ''; do
  gcovr --root "$root" --add-tracefile "$build/coverage.json" --sort-percentage ${what:+"$what"}
done
gcovr --root "$root" --add-tracefile "$build/coverage.json" --print-summary --output /dev/null
