#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

campaigns=no
rest=()
for option in "$@"; do
  if [ "$option" = --campaigns ]; then campaigns=yes; else rest+=("$option"); fi
done
read_data_option "${rest[@]}"
read_options "Installs what is missing, builds everything in build/release and runs every test.
  --data DIR   real measurements; without them the tests that read some are left out
  --campaigns  Monte Carlo over many minutes as well" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}"
configure_and_build release -D KDL_CALIBRATION_BUILD_TESTS=ON -D KDL_CALIBRATION_SHARED_DATA_DIR="$data"
run_tests release
run_long_tests release
if [ "$campaigns" = yes ]; then
  run_campaigns release
fi
