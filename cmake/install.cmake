# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Install, so that others can find_package(soilvdb) and #include <soilvdb/tracker.h>. Component
# `program` is the program alone, `python` the Python module alone, `development` the libraries.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)
set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/soilvdb)

# A build of some targets alone is refused before it is half installed.
foreach(module IN ITEMS core io draw run)
  foreach(library IN ITEMS soilvdb_${module} soilvdb_${module}_shared)
    install(CODE "
      if(NOT EXISTS \"$<TARGET_FILE:${library}>\")
        message(FATAL_ERROR \"$<TARGET_FILE_NAME:${library}> is not built: build all first, or \"
          \"install --component program or --component python\")
      endif()" COMPONENT development)
  endforeach()
endforeach()
foreach(module IN ITEMS core io draw run)
  install(TARGETS soilvdb_${module} EXPORT soilvdb-${module}-static
    ARCHIVE COMPONENT development)
  install(TARGETS soilvdb_${module}_shared EXPORT soilvdb-${module}-shared
    LIBRARY COMPONENT development)
  foreach(kind IN ITEMS static shared)
    install(EXPORT soilvdb-${module}-${kind} NAMESPACE soilvdb:: DESTINATION ${config_dir}
      COMPONENT development)
  endforeach()
endforeach()
install(DIRECTORY ${PROJECT_SOURCE_DIR}/core/include/ ${PROJECT_SOURCE_DIR}/io/include/
                  ${PROJECT_SOURCE_DIR}/tools/run/include/ ${PROJECT_BINARY_DIR}/include/
        DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)

# Where find_package() doesn't look, whose prefixes come from PATH: it serves once it is installed.
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/soilvdb-config.cmake.in
  ${PROJECT_BINARY_DIR}/installed/soilvdb-config.cmake INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/installed/soilvdb-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/installed/soilvdb-config.cmake
              ${PROJECT_BINARY_DIR}/installed/soilvdb-config-version.cmake
              ${CMAKE_CURRENT_LIST_DIR}/FindOpenVDB.cmake
        DESTINATION ${config_dir} COMPONENT development)

if(SOILVDB_TOOLS)
  install(TARGETS soilvdb RUNTIME COMPONENT program)
  # Made by tools/view/build, where npm was to be had.
  install(DIRECTORY ${PROJECT_BINARY_DIR}/view DESTINATION ${CMAKE_INSTALL_DATADIR}/soilvdb
    COMPONENT program OPTIONAL)
  install(FILES ${PROJECT_BINARY_DIR}/soilvdb.1 DESTINATION ${CMAKE_INSTALL_MANDIR}/man1
    COMPONENT program OPTIONAL)
  install(FILES ${PROJECT_SOURCE_DIR}/tools/packaging/completion.bash
          DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions RENAME soilvdb
    COMPONENT program)
endif()
