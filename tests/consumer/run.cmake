# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Installs soilvdb from `build` into a fresh prefix, builds the program in `source` against it, with
# every header that was installed, and checks the load it prints: with static libraries and with
# shared ones.
file(REMOVE_RECURSE ${work})
set(prefix ${work}/prefix)
function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ERROR_IS_FATAL ANY OUTPUT_VARIABLE output)
  set(output "${output}" PARENT_SCOPE)
endfunction()

run(${CMAKE_COMMAND} --install ${build} --prefix ${prefix})
file(GLOB_RECURSE headers RELATIVE ${prefix}/include ${prefix}/include/*.h)
list(TRANSFORM headers REPLACE "(.+)" "#include <\\1>\n" OUTPUT_VARIABLE includes)
list(JOIN includes "" includes)
file(WRITE ${prefix}/headers.cc "${includes}")
foreach(header IN LISTS headers)
  file(STRINGS ${prefix}/include/${header} found
       REGEX "#include .(cairo|yaml-cpp|fmt|gdal|proj|tinyxml2|assimp|nlohmann)")
  if(found)
    message(FATAL_ERROR "${header} needs more than core does: ${found}")
  endif()
endforeach()

function(check kind shared)
  run(${CMAKE_COMMAND} -S ${source} -B ${work}/${kind} -G ${generator}
      -DBUILD_SHARED_LIBS=${shared} -DHEADERS=${prefix}/headers.cc
      -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=${compiler}
      -DCMAKE_PREFIX_PATH=${prefix} -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF)
  run(${CMAKE_COMMAND} --build ${work}/${kind})
  run(${work}/${kind}/consumer)
  message("${output}")
  if(NOT output STREQUAL "load 0.400 m3\n")
    message(FATAL_ERROR "expected a load of 0.400 m3: 1 m wide, 0.2 m deep, 2 m long")
  endif()
  execute_process(COMMAND ldd ${work}/${kind}/consumer OUTPUT_VARIABLE needed)
  if(shared AND NOT needed MATCHES "libsoilvdb_core" OR NOT shared AND needed MATCHES "libsoilvdb")
    message(FATAL_ERROR "not linked with ${kind} libraries: ${needed}")
  endif()
endfunction()

check(static OFF)
check(shared ON)
