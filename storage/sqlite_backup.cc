#include "storage/sqlite_backup.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <filesystem>

#include "absl/strings/str_cat.h"
#include "storage/sqlite_lock.h"
#include "storage/sqlite_schema.h"

namespace orbitune {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kMigrationPrefix = "orbitune-schema";

fs::path DirectoryOf(const std::string& path) {
  const fs::path parent = fs::path(path).parent_path();
  return parent.empty() ? "." : parent;
}

// A file, or a directory with the names in it.
absl::Status SyncToDisk(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return absl::ErrnoToStatus(errno, absl::StrCat("cannot open ", path));
  const int result = fsync(fd);
  const int error = errno;
  close(fd);
  return result == 0 ? absl::OkStatus() : absl::UnavailableError(absl::StrCat(path, ": ", std::strerror(error)));
}

// Root's files would be of no use to the server, which runs as whom its data belong to.
void GiveToOwnerOf(const std::string& directory, const std::string& path) {
  struct stat owner {};
  if (geteuid() == 0 && stat(directory.c_str(), &owner) == 0) (void)!chown(path.c_str(), owner.st_uid, owner.st_gid);
}

absl::Status Rename(const std::string& from, const std::string& to) {
  std::error_code error;
  fs::rename(from, to, error);
  return error ? absl::ErrnoToStatus(error.value(), absl::StrCat("cannot rename ", from, " to ", to))
               : SyncToDisk(DirectoryOf(to).string());
}

absl::StatusOr<DatabaseSummary> SummaryOfSound(Connection& connection) {
  const auto faults = FindFaults(connection);
  if (!faults.ok()) return faults.status();
  if (!faults->empty()) {
    return absl::DataLossError(
        absl::StrCat(connection.path(), ": ", faults->front(),
                     faults->size() > 1 ? absl::StrCat(" (and ", faults->size() - 1, " more)") : ""));
  }
  return Summarise(connection);
}

// A copy in one file, checked; not on disk yet.
absl::StatusOr<DatabaseSummary> Copy(const std::string& source, const std::string& destination) {
  auto from = Connection::Open(source, Connection::Mode::kReadOnly);
  if (!from.ok()) return from.status();
  absl::Status status = CheckSchema(**from, static_cast<std::int64_t>(Migrations().size()));
  if (!status.ok()) return status;
  const auto version = (*from)->QueryInt("PRAGMA user_version");
  if (!version.ok()) return version.status();
  if (*version == 0) return absl::FailedPreconditionError(absl::StrCat(source, " is empty"));
  auto to = Connection::Open(destination, Connection::Mode::kReadWrite);
  if (!to.ok()) return to.status();
  // Whoever finds it has to see it whole: it is made sure of once, at the end.
  status = (*to)->Execute("PRAGMA journal_mode = OFF; PRAGMA synchronous = OFF;");
  if (status.ok()) status = (*to)->CopyFrom(**from);
  // What a backup is read with must not need to write beside it.
  if (status.ok()) status = (*to)->Execute("PRAGMA journal_mode = DELETE;");
  if (!status.ok()) return status;
  return SummaryOfSound(**to);
}

// At `destination` and on disk, or not there at all.
absl::StatusOr<DatabaseSummary> CopyDurably(const std::string& source, const std::string& destination) {
  std::error_code error;
  for (const char* suffix : {"", "-journal", "-wal", "-shm"}) fs::remove(absl::StrCat(destination, suffix), error);
  auto summary = Copy(source, destination);
  absl::Status status = summary.status();
  if (status.ok()) status = SyncToDisk(destination);
  if (status.ok()) return summary;
  fs::remove(destination, error);
  return status;
}

// The log of one that was not closed, as far as it can be, becomes part of it; what is left goes with it.
absl::Status MoveAside(const std::string& database, const std::string& aside) {
  if (auto old = Connection::Open(database, Connection::Mode::kReadWrite); old.ok()) {
    (void)(*old)->Execute("PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode = DELETE;");
  }
  std::error_code error;
  fs::remove(database + "-shm", error);
  if (fs::exists(database + "-wal", error)) {
    if (absl::Status status = Rename(database + "-wal", aside + "-wal"); !status.ok()) return status;
  }
  // Until the restored one takes it, the name stays with the old one: no start finds an empty place.
  fs::create_hard_link(database, aside, error);
  if (error) return Rename(database, aside);  // a file system without links
  return absl::OkStatus();
}

}  // namespace

std::string LockPathOf(const std::string& database) { return fs::path(database).replace_extension(".lock").string(); }

std::string NameBeside(const std::string& database, const std::string& what) {
  std::array<char, 32> time{};
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  std::strftime(time.data(), time.size(), "%Y%m%dT%H%M%SZ", gmtime_r(&now, &utc));
  const std::string stem = (DirectoryOf(database) / absl::StrCat("orbitune-", what, "-", time.data())).string();
  std::string name = stem + ".db";
  for (int n = 2; fs::exists(name); ++n) name = absl::StrCat(stem, "-", n, ".db");
  return name;
}

std::string MigrationBackupName(const std::string& database, std::int64_t version) {
  return NameBeside(database, absl::StrCat("schema", version));
}

std::vector<std::string> MigrationBackupsBeside(const std::string& database) {
  std::vector<std::pair<fs::file_time_type, std::string>> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(DirectoryOf(database), error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(kMigrationPrefix) && name.ends_with(".db")) {
      found.emplace_back(entry.last_write_time(error), entry.path().string());
    }
  }
  std::ranges::sort(found);
  std::vector<std::string> paths;
  for (auto& [time, path] : found) paths.push_back(std::move(path));
  return paths;
}

absl::StatusOr<DatabaseSummary> BackUpDatabase(const std::string& source, const std::string& destination) {
  std::error_code error;
  if (!fs::exists(source, error)) return absl::NotFoundError(absl::StrCat("there is no database ", source));
  if (fs::exists(destination, error)) {
    return absl::AlreadyExistsError(absl::StrCat(destination, " is there already; a backup overwrites nothing"));
  }
  const std::string partial = absl::StrCat(destination, ".partial");
  auto summary = CopyDurably(source, partial);
  if (!summary.ok()) return summary;
  if (absl::Status status = Rename(partial, destination); !status.ok()) return status;
  return summary;
}

absl::StatusOr<Restored> RestoreDatabase(const std::string& backup, const std::string& database) {
  std::error_code error;
  if (!fs::exists(backup, error)) return absl::NotFoundError(absl::StrCat("there is no backup ", backup));
  if (fs::equivalent(backup, database, error)) {
    return absl::FailedPreconditionError(absl::StrCat(backup, " is the database itself"));
  }
  auto lock = FileLock::Take(LockPathOf(database));
  if (!lock.ok()) return lock.status();
  const std::string incoming = database + ".restoring";
  auto summary = CopyDurably(backup, incoming);
  if (!summary.ok()) return summary.status();
  for (const std::string& path : {incoming, LockPathOf(database)}) {
    GiveToOwnerOf(DirectoryOf(database).string(), path);
  }
  Restored restored{.summary = *summary, .kept = {}};
  if (fs::exists(database, error)) {
    restored.kept = NameBeside(database, "replaced");
    if (absl::Status status = MoveAside(database, restored.kept); !status.ok()) return status;
  }
  if (absl::Status status = Rename(incoming, database); !status.ok()) return status;
  return restored;
}

}  // namespace orbitune
