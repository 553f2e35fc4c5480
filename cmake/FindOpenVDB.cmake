# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Hands over to OpenVDB's own find module, which lies in a folder where CMake doesn't look.
find_path(OpenVDB_MODULE_DIR FindOpenVDB.cmake
  PATH_SUFFIXES lib/${CMAKE_LIBRARY_ARCHITECTURE}/cmake/OpenVDB lib/cmake/OpenVDB)
mark_as_advanced(OpenVDB_MODULE_DIR)
if(NOT OpenVDB_MODULE_DIR)
  set(OpenVDB_FOUND FALSE)
  set(OpenVDB_NOT_FOUND_MESSAGE "FindOpenVDB.cmake is not there; install libopenvdb-dev.")
  return()
endif()

# It needs its neighbours, sets BUILD_SHARED_LIBS and reports each component as a notice.
set(_openvdb_saved_shared ${BUILD_SHARED_LIBS})
set(_openvdb_saved_level ${CMAKE_MESSAGE_LOG_LEVEL})
list(APPEND CMAKE_MODULE_PATH ${OpenVDB_MODULE_DIR})
set(CMAKE_MESSAGE_LOG_LEVEL WARNING)
include(${OpenVDB_MODULE_DIR}/FindOpenVDB.cmake)
list(REMOVE_ITEM CMAKE_MODULE_PATH ${OpenVDB_MODULE_DIR})
set(CMAKE_MESSAGE_LOG_LEVEL ${_openvdb_saved_level})
set(BUILD_SHARED_LIBS ${_openvdb_saved_shared})
