# What every target of ours shares: warnings as errors, reproducible floating point, sanitizers.

add_library(orbitune_options INTERFACE)
# No contraction: whether a*b+c is fused would otherwise depend on the compiler and its flags, and with it the bits.
target_compile_options(orbitune_options INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wno-missing-field-initializers -Werror
  -ffp-contract=off)
# No function's address stays writable once the program is loaded.
target_link_options(orbitune_options INTERFACE -Wl,-z,relro -Wl,-z,now)
if(ORBITUNE_SANITIZE)
  target_compile_options(orbitune_options INTERFACE
    -fsanitize=${ORBITUNE_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(orbitune_options INTERFACE -fsanitize=${ORBITUNE_SANITIZE})
endif()

# orbitune_library(<name> HEADERS <h...> [SOURCES <cc...>] [LINK <targets...>])
# One library per folder; headers in a FILE_SET, so that each is checked to compile alone.
function(orbitune_library name)
  cmake_parse_arguments(ARG "" "" "HEADERS;SOURCES;LINK" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_sources(${name} PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES ${ARG_HEADERS})
  set_target_properties(${name} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON LINKER_LANGUAGE CXX)
  target_link_libraries(${name} PUBLIC ${ARG_LINK} PRIVATE orbitune_options)
endfunction()

# orbitune_executable(<name> SOURCES <cc...> [LINK <targets...>])
function(orbitune_executable name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${name} PRIVATE ${ARG_LINK} orbitune_options)
endfunction()
