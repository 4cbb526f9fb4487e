#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

only=.
others=()
while [ $# -gt 0 ]; do
  case $1 in
    --only)
      only=${2:?--only needs a pattern}
      shift 2
      ;;
    *)
      others+=("$1")
      shift
      ;;
  esac
done
read_options "Breaks a copy of the library on purpose, one place after the other (tests/mutation/defects.tsv), and shows
which of the defects the tests notice. Everything happens in build/mutation.
  --only RE  only the defects whose line matches" "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" perl-base

copy=$root/build/mutation/source
build=$root/build/mutation/build
list=$root/tests/mutation/defects.tsv
mkdir -p "$copy"
for part in CMakeLists.txt CMakePresets.json include src tests urdf; do
  # What is unchanged keeps its time stamp, so that it is not compiled again.
  (cd "$root" && find "$part" -type f -exec sh -c 'cmp -s "$1" "$2/$1" || install -D -m 644 "$1" "$2/$1"' - {} "$copy" \;)
done

defects=$(grep -v '^#' "$list" | grep -E -- "$only")
suites=$(cut -f 2 <<<"$defects" | tr ' ' '\n' | sort -u)
export CCACHE_BASEDIR=$copy
# A shared library: the tests need not be linked again for each defect.
cmake -S "$copy" -B "$build" -D CMAKE_BUILD_TYPE=RelWithDebInfo -D CMAKE_CXX_FLAGS_RELWITHDEBINFO=-O1 \
  -D BUILD_SHARED_LIBS=ON -D KDL_CALIBRATION_BUILD_TESTS=ON >/dev/null
# shellcheck disable=SC2086
cmake --build "$build" -j "$jobs" --target kdl_calibration kdlcal $suites >/dev/null

run_suite() {
  (cd "$build/tests" && timeout 600 "./$1" --gtest_fail_fast --gtest_brief=1 --gtest_filter='-*OnRealData*') >/dev/null 2>&1
}
for suite in $suites; do
  run_suite "$suite" || { echo "$suite fails without any defect" >&2; exit 1; }
done

caught=0 survived=0 broken=0
while IFS=$'\t' read -r file named old new; do
  what="$file: $old -> ${new:-(nothing)}"
  if [ "$(OLD=$old perl -0ne 'print scalar(() = /\Q$ENV{OLD}\E/g)' "$root/$file")" != 1 ]; then
    echo "does not apply  $what"
    broken=$((broken + 1))
    continue
  fi
  OLD=$old NEW=$new perl -0pe 's/\Q$ENV{OLD}\E/$ENV{NEW}/' "$root/$file" >"$copy/$file"
  noticed=
  if cmake --build "$build" -j "$jobs" --target kdl_calibration >/dev/null 2>&1; then
    for suite in $named; do
      run_suite "$suite" || { noticed=$suite; break; }
    done
    if [ -n "$noticed" ]; then
      echo "caught          $what ($noticed)"
      caught=$((caught + 1))
    else
      echo "SURVIVED        $what"
      survived=$((survived + 1))
    fi
  else
    echo "does not build  $what"
    broken=$((broken + 1))
  fi
  cp "$root/$file" "$copy/$file"
done <<<"$defects"

total=$((caught + survived))
echo "$caught of $total defects caught, $survived survived, $broken could not be planted"
[ "$broken" -eq 0 ] && [ $((100 * caught)) -ge $((95 * total)) ]
