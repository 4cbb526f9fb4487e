#!/usr/bin/env bash
# colcon_test.sh <colcon> <sources> <folder>: builds the package by the command of the guide, and runs what it installs.
set -euo pipefail
colcon=$1
sources=$2
rm -rf "$3"
mkdir -p "$3"
cd "$3"
"$colcon" build --base-paths "$sources" --cmake-args -D KDL_CALIBRATION_BUILD_TESTS=OFF
# colcon's scripts use variables that are not set.
set +u
# shellcheck source=/dev/null
source install/setup.bash
set -u
kdlcal=install/kdl_calibration/bin/kdlcal
"$kdlcal" --version
"$kdlcal" model --targets 3 >model.txt
grep -q 33 model.txt
test -f install/kdl_calibration/share/kdl_calibration/package.xml
