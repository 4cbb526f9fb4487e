#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

long=yes
campaigns=no
rest=()
for option in "$@"; do
  case $option in
    --quick) long=no ;;
    --campaigns) campaigns=yes ;;
    *) rest+=("$option") ;;
  esac
done
read_data_option "${rest[@]}"
read_options "Installs what is missing, builds everything in build/release and runs every test.
  --data DIR   real measurements; without them the tests that read some are left out
  --quick      without Monte Carlo and tables over many seconds
  --campaigns  Monte Carlo over many minutes as well" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}"
configure_and_build release -D KDL_CALIBRATION_BUILD_TESTS=ON -D KDL_CALIBRATION_PYTHON=ON \
  -D KDL_CALIBRATION_SHARED_DATA_DIR="$data"
run_tests release
if [ "$long" = yes ]; then
  run_long_tests release
fi
if [ "$campaigns" = yes ]; then
  run_campaigns release
fi
