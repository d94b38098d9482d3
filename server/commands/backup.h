// `orbituned backup`, `restore` and `check`.
#pragma once

namespace orbitune {

int RunBackup(int argc, char** argv);
int RunRestore(int argc, char** argv);
int RunCheck(int argc, char** argv);

}  // namespace orbitune
