# What pkg-config, ROS 2 and Debian expect of an installed package. `cpack -G DEB` in a build folder makes the .deb.

# A static library needs all libraries at link time, a shared one only those of its headers.
set(pkg_config_requires "eigen3 orocos-kdl")
if(NOT BUILD_SHARED_LIBS)
  string(APPEND pkg_config_requires " urdfdom console_bridge tinyxml2 fmt nettle")
  set(pkg_config_libs -pthread)
endif()
set(pkg_config_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
file(RELATIVE_PATH prefix_from_pkg_config /prefix/${pkg_config_dir} /prefix)
configure_file(${CMAKE_CURRENT_LIST_DIR}/kdl_calibration.pc.in kdl_calibration.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/kdl_calibration.pc DESTINATION ${pkg_config_dir})

# An empty file of this name makes `ros2 pkg` find the package. `ros2 run` looks in lib/<package>, on every platform.
file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/ament/kdl_calibration "")
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/ament/kdl_calibration
        DESTINATION share/ament_index/resource_index/packages)
if(KDL_CALIBRATION_BUILD_EXECUTABLE)
  file(RELATIVE_PATH bin_from_ros /prefix/lib/kdl_calibration /prefix/${CMAKE_INSTALL_BINDIR})
  file(CREATE_LINK ${bin_from_ros}/kdlcal ${CMAKE_CURRENT_BINARY_DIR}/ament/kdlcal SYMBOLIC)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/ament/kdlcal DESTINATION lib/kdl_calibration)
endif()

# Inside another project packing is that project's matter.
if(NOT PROJECT_IS_TOP_LEVEL)
  return()
endif()
set(CPACK_PACKAGE_CONTACT "The kdl_calibration maintainers <maintainers@kdl-calibration.invalid>")
set(debian_doc_dir ${CMAKE_INSTALL_DATADIR}/doc/kdl-calibration)
configure_file(${CMAKE_CURRENT_LIST_DIR}/changelog.in debian/changelog @ONLY)
configure_file(${CMAKE_CURRENT_LIST_DIR}/copyright.in debian/copyright @ONLY)
file(ARCHIVE_CREATE OUTPUT ${CMAKE_CURRENT_BINARY_DIR}/debian/changelog.gz
     PATHS ${CMAKE_CURRENT_BINARY_DIR}/debian/changelog FORMAT raw COMPRESSION GZip COMPRESSION_LEVEL 9)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/debian/changelog.gz ${CMAKE_CURRENT_BINARY_DIR}/debian/copyright
        DESTINATION ${debian_doc_dir})

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME kdl-calibration)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
                                                WORLD_READ WORLD_EXECUTE)
set(CPACK_PACKAGE_DESCRIPTION
    "Finds the geometric errors of a robot arm from laser tracker measurements.
It states how accurately each error is known, and writes the corrected URDF.
This package contains the program kdlcal, the C++ library and its headers.")
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
if(BUILD_SHARED_LIBS)
  set(CPACK_DEBIAN_PACKAGE_GENERATE_SHLIBS ON)
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/debian/triggers "activate-noawait ldconfig\n")
  set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA ${CMAKE_CURRENT_BINARY_DIR}/debian/triggers)
endif()
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
# kdlcal runs without them. Programs that use the library need them.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "libconsole-bridge-dev, libeigen3-dev, libfmt-dev, liborocos-kdl-dev, \
libtinyxml2-dev, liburdfdom-dev, liburdfdom-headers-dev, nettle-dev")
# The Python package is a package of its own, at Debian's place for one version of Python.
if(python_package_built AND NOT BUILD_SHARED_LIBS)
  set(debian_python_dir lib/python3/dist-packages/kdl_calibration)
  install(TARGETS kdl_calibration_python COMPONENT debian_python EXCLUDE_FROM_ALL
          LIBRARY DESTINATION ${debian_python_dir})
  install(FILES ${python_package_files} COMPONENT debian_python EXCLUDE_FROM_ALL DESTINATION ${debian_python_dir})
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/debian/changelog.gz ${CMAKE_CURRENT_BINARY_DIR}/debian/copyright
          COMPONENT debian_python EXCLUDE_FROM_ALL DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-kdl-calibration)
  set(CPACK_DEB_COMPONENT_INSTALL ON)
  set(CPACK_COMPONENTS_ALL Unspecified debian_python)
  set(CPACK_DEBIAN_UNSPECIFIED_PACKAGE_NAME kdl-calibration)
  set(CPACK_DEBIAN_DEBIAN_PYTHON_PACKAGE_NAME python3-kdl-calibration)
  set(CPACK_DEBIAN_DEBIAN_PYTHON_PACKAGE_SECTION python)
  math(EXPR next_minor "${python_minor} + 1")
  set(CPACK_DEBIAN_DEBIAN_PYTHON_PACKAGE_DEPENDS
      "python3 (>= 3.${python_minor}), python3 (<< 3.${next_minor}), python3-numpy")
  set(CPACK_DEBIAN_DEBIAN_PYTHON_PACKAGE_RECOMMENDS "python3-matplotlib")
  set(CPACK_COMPONENT_DEBIAN_PYTHON_DESCRIPTION
      "Kinematic calibration of robot arms in Python.
Arrays of numpy in, arrays out: calibration, predictions with their
uncertainty, plans, compensation.")
  set(CPACK_COMPONENT_UNSPECIFIED_DESCRIPTION "${CPACK_PACKAGE_DESCRIPTION}")
endif()
include(CPack)
