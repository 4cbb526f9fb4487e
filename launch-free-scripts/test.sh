#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Installs what is missing, builds everything in build/release and runs every test." "$@"
install_missing "${build_packages[@]}" "${test_packages[@]}"
configure_and_build release -D KDL_CALIBRATION_BUILD_TESTS=ON
run_tests release
