#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_data_option "$@"
read_options "Installs what is missing, builds everything in build/release and runs every test.
  --data DIR  real measurements; without them the tests that read some are left out" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}"
configure_and_build release -D KDL_CALIBRATION_BUILD_TESTS=ON -D KDL_CALIBRATION_SHARED_DATA_DIR="$data"
run_tests release
run_long_tests release
