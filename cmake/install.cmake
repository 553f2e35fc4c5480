# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Install, so that others can find_package(soilvdb) and #include <soilvdb/tracker.h>.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/soilvdb)

foreach(module IN ITEMS core io draw run)
  install(TARGETS soilvdb_${module} EXPORT soilvdb-${module}-static)
  install(TARGETS soilvdb_${module}_shared EXPORT soilvdb-${module}-shared)
  foreach(kind IN ITEMS static shared)
    install(EXPORT soilvdb-${module}-${kind} NAMESPACE soilvdb:: DESTINATION ${config_dir})
  endforeach()
endforeach()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/core/include/ ${PROJECT_SOURCE_DIR}/io/include/
                  ${PROJECT_SOURCE_DIR}/tools/run/include/ ${PROJECT_BINARY_DIR}/include/
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})

# Where find_package() doesn't look, whose prefixes come from PATH: it serves once it is installed.
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/soilvdb-config.cmake.in
  ${PROJECT_BINARY_DIR}/installed/soilvdb-config.cmake INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/installed/soilvdb-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/installed/soilvdb-config.cmake
              ${PROJECT_BINARY_DIR}/installed/soilvdb-config-version.cmake
              ${CMAKE_CURRENT_LIST_DIR}/FindOpenVDB.cmake
        DESTINATION ${config_dir})

if(SOILVDB_TOOLS)
  install(TARGETS soilvdb)
  # Made by tools/view/build, where npm was to be had.
  install(DIRECTORY ${PROJECT_BINARY_DIR}/view DESTINATION ${CMAKE_INSTALL_DATADIR}/soilvdb OPTIONAL)
  install(FILES ${PROJECT_BINARY_DIR}/soilvdb.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  install(FILES ${PROJECT_SOURCE_DIR}/tools/packaging/completion.bash
          DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME soilvdb)
endif()
