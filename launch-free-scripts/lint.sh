#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

built=
others=()
for option in "$@"; do
  case $option in
    --tidy) built=kdlcal ;;
    --tidy-tests) built=all ;;
    *) others+=("$option") ;;
  esac
done
read_options "Installs what is missing and checks form: clang-format on every source, shellcheck on every script.
  --tidy        clang-tidy as well on library and program, in the units of build/sanitizers
  --tidy-tests  and on the tests" \
  "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" clang-format shellcheck

cd "$root"
mapfile -t sources < <(git ls-files '*.cpp' '*.hpp')
mapfile -t scripts < <(git ls-files '*.sh' .ci/run)
clang-format --dry-run -Werror "${sources[@]}"
shellcheck "${scripts[@]}"
echo "${#sources[@]} sources are formatted, ${#scripts[@]} scripts without a finding"
[ -n "$built" ] || exit 0

# The units that clang compiles, with its precompiled headers: it reads the headers of a unit once.
install_missing "${clang_packages[@]}" clang-tidy python3
cmake --preset sanitizers >/dev/null
cmake --build build/sanitizers -j "$jobs" --target "$built" >/dev/null
found=0
python3 - "$built" >build/sanitizers/tidy_units.txt <<'EOF'
import json, re, sys
for entry in json.load(open("build/sanitizers/compile_commands.json")):
    target = re.search(r"CMakeFiles/([^/]+)\.dir/", entry["command"].split(" -o ")[1]).group(1)
    of_tests = re.search(r"_tests|fuzz|faults", target)
    if "cmake_pch" not in entry["file"] and (sys.argv[1] == "all" or not of_tests):
        print(entry["file"])
EOF
xargs -P "$jobs" -n 1 clang-tidy --quiet -p build/sanitizers --checks=-bugprone-suspicious-include \
  --header-filter='/(include/kdl_calibration|src|tests)/.*\.[ch]pp$' \
  <build/sanitizers/tidy_units.txt >build/sanitizers/clang-tidy.log 2>/dev/null || found=1
if [ "$found" -ne 0 ]; then
  grep -E '(warning|error):' build/sanitizers/clang-tidy.log | sort -u
  echo "clang-tidy: findings, see $root/build/sanitizers/clang-tidy.log" >&2
  exit 1
fi
echo "clang-tidy finds nothing in $(wc -l <build/sanitizers/tidy_units.txt) units"
