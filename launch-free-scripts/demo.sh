#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Installs what is missing, builds kdlcal and runs the published experiment in build/demo." "$@"
install_missing "${build_packages[@]}"
configure_and_build release -D KDL_CALIBRATION_BUILD_TESTS=OFF

show() {
  echo
  echo "\$ kdlcal $*"
  "$root/build/release/kdlcal" "$@"
}

rm -rf "$root/build/demo"
mkdir -p "$root/build/demo"
cd "$root/build/demo"

# The published ranges, less what is beyond the robot's limits.
show simulate --configurations 30 --test-configurations 100 --targets 3 --noise 0.00003 \
  --joint-ranges=-90:90,-75:60,-90:90,-90:90,-120:120,-180:180 \
  --seed 1 --output measurements.csv --truth truth.json
show calibrate --measurements measurements.csv --output calibrated.urdf --result result.json --report report.html
# The estimator as published, on the same measurements; its list of errors is left out.
show calibrate --measurements measurements.csv --method two-step --result two_step.json | sed '/^geometric errors/,$d'
show validate --urdf calibrated.urdf --measurements measurements.csv

echo
echo "The files are in $root/build/demo; the page to look at is $root/build/demo/report.html"
