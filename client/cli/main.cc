// The command line client `orbitune`.
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdlib>
#include <cstring>
#include <iostream>
#include <string>
#include <vector>

#include "client/cli/app.h"
#include "client/cli/errors.h"

namespace {

bool CanRedraw() {
  const char* const kind = std::getenv("TERM");
  return isatty(STDOUT_FILENO) == 1 && kind != nullptr && std::strcmp(kind, "dumb") != 0;
}

int Columns() {
  winsize size{};
  const bool known = ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0 && size.ws_col > 0;
  return known ? size.ws_col : 80;
}

}  // namespace

int main(int argc, char** argv) {
  std::ios::sync_with_stdio(false);
  orbitune::cli::Terminal terminal{&std::cout, &std::cerr, nullptr};
  if (CanRedraw()) terminal.width = Columns;
  const int code = orbitune::cli::RunCli(std::vector<std::string>(argv + 1, argv + argc), terminal);
  if (std::cout.flush()) return code;
  std::cerr << "orbitune: cannot write to stdout\n";
  return code != 0 ? code : orbitune::cli::kExitUsage;
}
