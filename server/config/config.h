// What orbituned is told: flags before environment before configuration file before defaults.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace orbitune {

struct ServerConfig {
  std::string data_dir;
  std::string listen = "127.0.0.1:7313";
  std::string http = "127.0.0.1:7314";  // "off": none
  std::string web_dir;
  std::vector<std::string> http_cors_origins;
  int http_max_connections = 1024;
  int http_max_header_bytes = 16 << 10;
  int http_max_body_bytes = 16 << 20;
  double http_header_time_s = 10;
  double http_body_time_s = 60;
  double http_idle_time_s = 60;
  double http_stall_time_s = 30;
  std::string tls_cert;  // PEM files; empty: in the clear
  std::string tls_key;
  std::string tls_client_ca;  // clients must have a certificate; empty: they need none
  bool insecure = false;      // listen on an open address whatever is missing
  int threads = 0;            // 0: one per core
  int max_running_jobs = 64;
  std::string simd = "auto";
};

// Where the database is kept unless --data-dir or ORBITUNE_DATA_DIR says.
std::string DefaultDataDir();

// Parses the command line. footer: for the end of the help. Nothing if the process is to end at once, with `exit_code`:
// after --help, --version, or an error that was printed.
std::optional<ServerConfig> ParseServerConfig(int argc, char** argv, const std::string& footer, int& exit_code);

}  // namespace orbitune
