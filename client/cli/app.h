// The program behind main(): the command line, parsed and run.
#pragma once

#include <functional>
#include <ostream>
#include <string>
#include <vector>

namespace orbitune::cli {

inline constexpr char kDefaultServer[] = "127.0.0.1:7313";

// The options that every command takes.
struct Globals {
  std::string server = kDefaultServer;  // HOST:PORT, or https://HOST:PORT for TLS
  std::string token_file;
  std::string tls_ca;  // PEM files
  std::string tls_cert;
  std::string tls_key;
  bool insecure = false;  // a token may go where others can read it
  bool json = false;
  double timeout_s = 30;  // of a unary call, > 0
};

// Where output goes. `width` gives the terminal's columns now; empty where `out` is no terminal.
struct Terminal {
  std::ostream* out;
  std::ostream* err;
  std::function<int()> width;
};

// To the beginning of the line, and nothing more on it.
inline constexpr char kClearLine[] = "\r\x1b[K";

// `arguments` without the program's name. Returns the exit code. SIGINT is taken over while a job is watched.
int RunCli(const std::vector<std::string>& arguments, const Terminal& terminal);

}  // namespace orbitune::cli
