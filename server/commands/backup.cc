#include "server/commands/backup.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "server/commands/support.h"
#include "server/config/config.h"
#include "storage/sqlite_backup.h"

namespace orbitune {
namespace {

std::string DatabaseIn(const std::string& data_dir) { return data_dir + "/orbitune.db"; }

// The command's one argument and its data directory. Nothing if the process is to end at once, with exit_code.
struct Arguments {
  std::string data_dir = DefaultDataDir();
  std::string file;
};
std::optional<Arguments> Parse(CLI::App& app, bool file_required, const char* file_name, const char* file_means,
                               int argc, char** argv, int& exit_code) {
  Arguments arguments;
  app.add_option("--data-dir", arguments.data_dir, "The server's")->envname("ORBITUNE_DATA_DIR")->capture_default_str();
  app.add_option(file_name, arguments.file, file_means)->required(file_required);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    exit_code = app.exit(error) == 0 ? 0 : 2;
    return std::nullopt;
  }
  return arguments;
}

absl::StatusOr<int> Check(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return absl::NotFoundError(absl::StrCat("there is no database ", path));
  auto connection = Connection::Open(path, Connection::Mode::kReadOnly);
  if (!connection.ok()) return connection.status();
  // One state of it, whatever is written meanwhile.
  const auto transaction = Transaction::Begin(**connection, Transaction::Kind::kRead);
  if (!transaction.ok()) return transaction.status();
  const auto faults = FindFaults(**connection);
  if (!faults.ok()) return faults.status();
  for (const std::string& fault : *faults) std::printf("%s: %s\n", path.c_str(), fault.c_str());
  if (!faults->empty()) return 1;
  const auto summary = Summarise(**connection);
  if (!summary.ok()) return summary.status();
  std::printf("%s: no fault found: %s\n", path.c_str(), ToString(*summary).c_str());
  return 0;
}

}  // namespace

int RunBackup(int argc, char** argv) {
  CLI::App app(
      "Copies the database, as it is at one moment, to a new file; a server that runs is not disturbed. The copy is "
      "checked, and on disk before it has its name. Tokens and the audit log (access.db) are not part of it.",
      "orbituned backup");
  int exit_code = 0;
  const auto arguments =
      Parse(app, true, "DEST", "The file to be written, or a directory to write one in", argc, argv, exit_code);
  if (!arguments) return exit_code;
  const std::string database = DatabaseIn(arguments->data_dir);
  std::error_code error;
  const bool in_directory = std::filesystem::is_directory(arguments->file, error);
  const std::string destination =
      in_directory ? NameBeside(arguments->file + "/orbitune.db", "backup") : arguments->file;
  const auto summary = BackUpDatabase(database, destination);
  if (!summary.ok()) return FailCommand(summary.status());
  std::printf("%s: %s\n", destination.c_str(), ToString(*summary).c_str());
  return 0;
}

int RunRestore(int argc, char** argv) {
  CLI::App app(
      "Puts a copy of a backup in the database's place. The server must be stopped; the backup is checked first, and "
      "the database that was there stays beside it under another name.",
      "orbituned restore");
  int exit_code = 0;
  const auto arguments = Parse(app, true, "BACKUP", "What orbituned backup has written", argc, argv, exit_code);
  if (!arguments) return exit_code;
  std::error_code error;
  std::filesystem::create_directories(arguments->data_dir, error);
  const auto restored = RestoreDatabase(arguments->file, DatabaseIn(arguments->data_dir));
  if (!restored.ok()) return FailCommand(restored.status());
  std::printf("%s: %s\n", DatabaseIn(arguments->data_dir).c_str(), ToString(restored->summary).c_str());
  if (!restored->kept.empty()) std::printf("what was there before is now %s\n", restored->kept.c_str());
  return 0;
}

int RunCheck(int argc, char** argv) {
  CLI::App app(
      "Reads the whole database and tells every fault: of its pages, its indexes, and of what its tables say of each "
      "other. A server that runs is not disturbed. Exit status 1: there are faults.",
      "orbituned check");
  int exit_code = 0;
  const auto arguments = Parse(app, false, "FILE", "A backup to be checked instead of the data directory's database",
                               argc, argv, exit_code);
  if (!arguments) return exit_code;
  const auto checked = Check(arguments->file.empty() ? DatabaseIn(arguments->data_dir) : arguments->file);
  return checked.ok() ? *checked : FailCommand(checked.status());
}

}  // namespace orbitune
