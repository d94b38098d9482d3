// A check for what only a bug can cause: says where, and ends the process.
#pragma once

#include <cstdio>
#include <cstdlib>

#define ORBITUNE_CHECK(condition)                                                        \
  do {                                                                                   \
    if (!(condition)) {                                                                  \
      std::fprintf(stderr, "%s:%d: check failed: %s\n", __FILE__, __LINE__, #condition); \
      std::abort();                                                                      \
    }                                                                                    \
  } while (false)
