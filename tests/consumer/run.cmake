# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
# Installs soilvdb from `build` into a fresh prefix, builds the program in `source` against it, with
# every header that was installed, and checks the load it prints. With `root`, the project's sources,
# it does the same with shared libraries, which it builds first.
file(REMOVE_RECURSE ${work})
function(run)
  execute_process(COMMAND ${ARGV} COMMAND_ERROR_IS_FATAL ANY OUTPUT_VARIABLE output)
  set(output "${output}" PARENT_SCOPE)
endfunction()

function(check build prefix)
  run(${CMAKE_COMMAND} --install ${build} --prefix ${prefix})
  file(GLOB_RECURSE headers RELATIVE ${prefix}/include ${prefix}/include/*.h)
  list(TRANSFORM headers REPLACE "(.+)" "#include <\\1>\n" OUTPUT_VARIABLE includes)
  list(JOIN includes "" includes)
  file(WRITE ${prefix}/headers.cc "${includes}")
  foreach(foreign IN ITEMS cairo yaml-cpp fmt gdal tinyxml2 assimp nlohmann)
    file(GLOB_RECURSE all ${prefix}/include/*.h)
    foreach(header IN LISTS all)
      file(STRINGS ${header} found REGEX "#include .${foreign}")
      if(found)
        message(FATAL_ERROR "${header} needs ${foreign}")
      endif()
    endforeach()
  endforeach()
  set(flags "")
  if(sanitize)
    set(flags -DCMAKE_CXX_FLAGS=-fsanitize=${sanitize})
  endif()
  run(${CMAKE_COMMAND} -S ${source} -B ${prefix}/build -G ${generator} ${flags}
      -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=${compiler} -DHEADERS=${prefix}/headers.cc
      -DCMAKE_PREFIX_PATH=${prefix} -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF)
  run(${CMAKE_COMMAND} --build ${prefix}/build)
  run(${prefix}/build/consumer)
  message("${output}")
  if(NOT output STREQUAL "load 0.400 m3\n")
    message(FATAL_ERROR "expected a load of 0.400 m3: 1 m wide, 0.2 m deep, 2 m long")
  endif()
endfunction()

check(${build} ${work}/static)
if(root)
  run(${CMAKE_COMMAND} -S ${root} -B ${work}/shared_build -G ${generator} --log-level=WARNING
      -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER=${compiler} -DBUILD_SHARED_LIBS=ON
      -DSOILVDB_WERROR=${werror} -DSOILVDB_TOOLS=OFF -DSOILVDB_TESTS=OFF -DSOILVDB_BENCH=OFF)
  run(${CMAKE_COMMAND} --build ${work}/shared_build)
  check(${work}/shared_build ${work}/shared)
  file(GLOB libraries ${work}/shared/lib*/*.so ${work}/shared/lib/*/*.so)
  list(LENGTH libraries count)
  if(NOT count EQUAL 3)
    message(FATAL_ERROR "expected shared libraries core, io and draw, not: ${libraries}")
  endif()
endif()
