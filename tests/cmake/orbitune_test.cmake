# A GoogleTest executable whose tests ctest runs one by one.
include_guard()
find_package(GTest REQUIRED)
include(GoogleTest)

# orbitune_test(<name> SOURCES <cc...> [LINK <targets...>] [LABELS <label>] [PROCESSORS <n>])
# LABELS concurrency: what the ThreadSanitizer build builds
# and runs (target concurrency_tests). PROCESSORS: the threads that each of its tests keeps busy.
function(orbitune_test name)
  cmake_parse_arguments(ARG "" "LABELS;PROCESSORS" "SOURCES;LINK" ${ARGN})
  if(ARG_UNPARSED_ARGUMENTS)
    message(FATAL_ERROR "orbitune_test(${name}): unexpected ${ARG_UNPARSED_ARGUMENTS} (there can be one label)")
  endif()
  orbitune_executable(${name} SOURCES ${ARG_SOURCES} LINK ${ARG_LINK} GTest::gmock GTest::gtest_main)
  target_compile_options(${name} PRIVATE -O1)  # what takes time is in the libraries
  # A test that hangs fails; the limit judges nothing else.
  set(properties TIMEOUT 900)
  foreach(property LABELS PROCESSORS)
    if(ARG_${property})
      list(APPEND properties ${property} ${ARG_${property}})
    endif()
  endforeach()
  if(ARG_LABELS STREQUAL "concurrency")
    if(NOT TARGET concurrency_tests)
      add_custom_target(concurrency_tests)
    endif()
    add_dependencies(concurrency_tests ${name})
  endif()
  gtest_discover_tests(${name} DISCOVERY_TIMEOUT 60 PROPERTIES ${properties})
endfunction()
