# Installs the package from `build_dir` into an empty prefix, then configures, builds and runs against it
#   - the consumer whose main.cpp and CMakeLists.txt are the blocks of the README that stand behind the comments
#     <!-- consumer: main.cpp -->  and  <!-- consumer: CMakeLists.txt -->
#   - the programs beside this file, which one of `guide` and `path` has to quote byte for byte.
# All run in `work_dir`/run, which holds robot.urdf and, made by the installed kdlcal, measurements.csv.
# One program is also built against the unpacked .deb: by clang where it is installed, and with pkg-config.
# The compiler flags of the package carry over, so that this also works in a sanitized build.
cmake_minimum_required(VERSION 3.22)

# Writes the first fenced block of `language` behind the marker of `file`.
function(extract_block file language)
  file(READ ${readme} text)
  set(marker "<!-- consumer: ${file} -->")
  string(FIND "${text}" "${marker}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "${readme}: no comment '${marker}'")
  endif()
  string(SUBSTRING "${text}" ${at} -1 text)
  set(fence "```${language}\n")
  string(FIND "${text}" "${fence}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "${readme}: no ${language} block behind '${marker}'")
  endif()
  string(LENGTH "${fence}" length)
  math(EXPR at "${at} + ${length}")
  string(SUBSTRING "${text}" ${at} -1 text)
  string(FIND "${text}" "```" at)
  string(SUBSTRING "${text}" 0 ${at} text)
  file(WRITE ${work_dir}/source/${file} "${text}")
endfunction()

function(run)
  execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

file(REMOVE_RECURSE ${work_dir})
file(MAKE_DIRECTORY ${work_dir}/run)
extract_block(main.cpp cpp)
extract_block(CMakeLists.txt cmake)

file(READ ${guide} quoted)
file(READ ${path} quoted_too)
string(APPEND quoted "${quoted_too}")
file(GLOB quotes ${CMAKE_CURRENT_LIST_DIR}/*.cpp ${CMAKE_CURRENT_LIST_DIR}/*.py)
foreach(source IN LISTS quotes)
  file(READ ${source} text)
  string(FIND "${quoted}" "${text}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "neither ${guide} nor ${path} quotes ${source} as it stands")
  endif()
endforeach()

# Configures and builds the project in `source` into `build`/bin, or what the other arguments of the build name.
function(build_against_package source build)
  run(${CMAKE_COMMAND} -S ${source} -B ${build} -G ${generator} -D CMAKE_PREFIX_PATH=${prefix}
      -D CMAKE_MAKE_PROGRAM=${make_program} -D CMAKE_BUILD_TYPE=${config} -D CMAKE_CXX_COMPILER=${cxx_compiler}
      -D CMAKE_CXX_FLAGS=${cxx_flags} -D CMAKE_RUNTIME_OUTPUT_DIRECTORY=${build}/bin)
  run(${CMAKE_COMMAND} --build ${build} --config ${config} ${ARGN})
endfunction()

# Runs kdlcal in the folder of the installed example. Its README has to quote the output up to `end`.
function(check_example end)
  set(example ${prefix}/share/kdl_calibration/examples)
  execute_process(COMMAND ${prefix}/bin/kdlcal ${ARGN} WORKING_DIRECTORY ${example} OUTPUT_VARIABLE output
                  COMMAND_ERROR_IS_FATAL ANY)
  string(FIND "${output}" "${end}" length)
  string(SUBSTRING "${output}" 0 ${length} output)
  string(REGEX REPLACE "\n([^\n])" "\n    \\1" quote "\n${output}")
  file(READ ${example}/README.md text)
  string(FIND "${text}" "${quote}" at)
  if(at EQUAL -1)
    message(FATAL_ERROR "${example}/README.md does not quote\n${quote}")
  endif()
endfunction()

set(prefix ${work_dir}/prefix)
run(${CMAKE_COMMAND} --install ${build_dir} --config ${config} --prefix ${prefix})
build_against_package(${work_dir}/source ${work_dir}/build)
build_against_package(${CMAKE_CURRENT_LIST_DIR} ${work_dir}/programs)

file(COPY_FILE ${prefix}/share/kdl_calibration/urdf/fanuc_r2000ic_165f.urdf ${work_dir}/run/robot.urdf)
if(EXISTS ${prefix}/bin/kdlcal)
  # It takes the robot that was installed with it, not the one in the tree that it was built from.
  set(own ${prefix}/share/kdl_calibration/urdf/fanuc_r2000ic_165f.urdf)
  file(READ ${own} as_installed)
  string(REPLACE "<robot name=\"fanuc_r2000ic_165f\"" "<robot name=\"installed\"" changed "${as_installed}")
  file(WRITE ${own} "${changed}")
  execute_process(COMMAND ${prefix}/bin/kdlcal model OUTPUT_VARIABLE model COMMAND_ERROR_IS_FATAL ANY)
  if(NOT model MATCHES "installed:")
    message(FATAL_ERROR "the installed kdlcal does not read ${own}")
  endif()
  file(WRITE ${own} "${as_installed}")
  check_example("\nnoise per" calibrate --measurements measurements.csv --result ${work_dir}/run/example.json
                --joint-convention ../urdf/fanuc_r2000ic_165f_pendant.json)
  check_example("\n\n" validate --result ${work_dir}/run/example.json --truth truth.json)
  run(${prefix}/bin/kdlcal simulate --configurations 30 --targets 3 --noise 0.00003 --seed 1
      --output ${work_dir}/run/measurements.csv --truth ${work_dir}/run/truth.json)
endif()
file(GLOB_RECURSE programs LIST_DIRECTORIES false ${work_dir}/build/bin/*)
list(LENGTH programs count)
if(NOT count EQUAL 1)
  message(FATAL_ERROR "expected one program from the README's CMakeLists.txt, found '${programs}'")
endif()
run(${CMAKE_COMMAND} -E chdir ${work_dir}/run ${programs})

foreach(name calibrate_and_export predict inverse_kinematics plan simulate in_memory control_loop)
  run(${CMAKE_COMMAND} -E chdir ${work_dir}/run ${work_dir}/programs/bin/${name})
endforeach()
if(python AND EXISTS ${python})
  execute_process(COMMAND ${python} -c "import numpy" RESULT_VARIABLE no_numpy ERROR_QUIET)
  if(no_numpy)
    message(STATUS "numpy is not installed: read_result.py is not run")
  else()
    run(${CMAKE_COMMAND} -E chdir ${work_dir}/run ${python} ${CMAKE_CURRENT_LIST_DIR}/read_result.py)
  endif()
endif()

# The package of Debian.
find_program(shlibdeps dpkg-shlibdeps)
if(NOT shlibdeps)
  message(STATUS "dpkg-dev is not installed: the Debian package is not tested")
  return()
endif()
# cpack would first build all targets of a folder with makefiles. With Ninja it does not.
run(${CMAKE_COMMAND} -E chdir ${build_dir} ${CMAKE_CPACK_COMMAND} -G DEB -C ${config} -B ${work_dir}/deb
    -D CPACK_CMAKE_GENERATOR=Ninja)
file(GLOB deb ${work_dir}/deb/*.deb)
foreach(file IN LISTS deb)
  run(dpkg-deb -x ${file} ${work_dir}/deb/root)
endforeach()
set(prefix ${work_dir}/deb/root/usr)
run(${prefix}/lib/kdl_calibration/kdlcal --version)
if(EXISTS ${prefix}/lib/python3/dist-packages)
  run(${CMAKE_COMMAND} -E env PYTHONPATH=${prefix}/lib/python3/dist-packages ${python} -B -c
      "import kdl_calibration as kc; print(kc.__version__, kc.load_robot('${work_dir}/run/robot.urdf'))")
endif()
if(NOT EXISTS ${prefix}/share/ament_index/resource_index/packages/kdl_calibration)
  message(FATAL_ERROR "the package does not stand in the index of ROS 2")
endif()
find_program(lintian lintian)
if(lintian)
  run(${lintian} --allow-root --fail-on error ${deb})
endif()

find_program(clang clang++)
if(clang AND NOT cxx_flags)  # which may be flags for one compiler
  set(cxx_compiler ${clang})
endif()
build_against_package(${CMAKE_CURRENT_LIST_DIR} ${work_dir}/deb/predict --target predict kdlcal_version)
run(${CMAKE_COMMAND} -E chdir ${work_dir}/run ${work_dir}/deb/predict/bin/predict)

find_program(pkg_config pkg-config)
if(pkg_config)
  file(GLOB_RECURSE pc ${prefix}/lib/kdl_calibration.pc)
  cmake_path(GET pc PARENT_PATH pc_dir)
  set(ENV{PKG_CONFIG_PATH} ${pc_dir})
  execute_process(COMMAND ${pkg_config} --cflags --libs kdl_calibration OUTPUT_VARIABLE flags
                  COMMAND_ERROR_IS_FATAL ANY)
  separate_arguments(flags UNIX_COMMAND "${cxx_flags} ${flags}")
  run(${cxx_compiler} -std=c++20 ${CMAKE_CURRENT_LIST_DIR}/predict.cpp ${flags} -o ${work_dir}/run/predict)
  run(${CMAKE_COMMAND} -E env LD_LIBRARY_PATH=${prefix}/lib ${CMAKE_COMMAND} -E chdir ${work_dir}/run
      ${work_dir}/run/predict)
endif()
