// What orbituned is told: flags before environment before configuration file before defaults.
#pragma once

#include <cstdint>
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
  int http_max_connections_per_client = 768;
  int http_max_header_bytes = 16 << 10;
  int http_max_body_bytes = 16 << 20;
  int http_max_bodies_bytes = 64 << 20;
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
  int max_queued_jobs = 100'000;
  int max_jobs_per_client = 1000;
  int max_job_memory_mib = 256;
  int max_campaigns_per_client = 100;
  int max_calls_waiting = 4096;
  int max_calls_waiting_per_client = 1024;
  int max_episode_calls = 3;
  int max_verifications = 2;
  int max_waiting_mib = 256;
  int max_request_bytes = 16 << 20;
  int max_response_bytes = 64 << 20;
  int max_watchers = 4096;
  int max_watchers_per_client = 2048;
  int max_streams_per_connection = 2000;
  int grpc_memory_mib = 256;
  std::string log_format = "text";
  std::string log_level = "info";
  double log_slow_call_s = 1;
  std::string simd = "auto";
  std::string start_check = "crash";  // or "full", "off"
  double retain_jobs_days = 0;        // 0, here and below: kept for ever
  double retain_campaigns_days = 0;
  double retain_iterations_days = 0;
  double retain_backups_days = 0;
  double retain_audit_days = 0;
  std::uint64_t max_database_bytes = 0;  // 0: no limit
};

// Where the database is kept unless --data-dir or ORBITUNE_DATA_DIR says.
std::string DefaultDataDir();

// Parses the command line. footer: for the end of the help. Nothing if the process is to end at once, with `exit_code`:
// after --help, --version, or an error that was printed.
std::optional<ServerConfig> ParseServerConfig(int argc, char** argv, const std::string& footer, int& exit_code);

}  // namespace orbitune
