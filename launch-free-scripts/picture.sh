#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Runs the demo and takes the picture of its page that the README shows." "$@"
install_missing "${build_packages[@]}" "${browser_packages[@]}"
"$root/launch-free-scripts/demo.sh" >/dev/null
/usr/bin/python3 -B "$root/tests/browser/picture.py" "$root/build/demo/report.html" \
  "$root/src/results/report/report.png"
ls -l "$root/src/results/report/report.png"
