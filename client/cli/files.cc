#include "client/cli/files.h"

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <sstream>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "google/protobuf/util/json_util.h"

namespace orbitune::cli {

absl::StatusOr<std::string> ReadTextFile(const std::string& path) {
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  std::ostringstream text;
  if (file) text << file.rdbuf();
  if (!file || !text) {
    const char* const reason = errno != 0 ? std::strerror(errno) : "it is empty";
    return absl::InvalidArgumentError(absl::StrCat("cannot read ", path, ": ", reason));
  }
  return text.str();
}

absl::Status ParseJson(const std::string& text, const std::string& name, google::protobuf::Message* message) {
  const auto status = google::protobuf::util::JsonStringToMessage(text, message);
  if (status.ok()) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(name, " is not a ", message->GetDescriptor()->name(), " in JSON: ", status.message().ToString()));
}

absl::Status ReadJsonFile(const std::string& path, google::protobuf::Message* message) {
  const absl::StatusOr<std::string> text = ReadTextFile(path);
  return text.ok() ? ParseJson(*text, path, message) : text.status();
}

OutputFile::OutputFile(const std::string& path) : path_(path), written_path_(path) {
  std::error_code ignored;
  const bool special = std::filesystem::exists(path_, ignored) && !std::filesystem::is_regular_file(path_, ignored);
  if (!special) {
    if (std::filesystem::exists(path_, ignored)) path_ = std::filesystem::canonical(path_, ignored);
    written_path_ = absl::StrCat(path_.string(), ".tmp.", getpid());
  }
  errno = 0;
  stream_.open(written_path_, std::ios::binary | std::ios::trunc);
  if (!stream_) status_ = Error("open");
}

OutputFile::~OutputFile() {
  if (!stream_.is_open() || written_path_ == path_) return;
  stream_.close();
  std::error_code ignored;
  std::filesystem::remove(written_path_, ignored);
}

absl::Status OutputFile::Commit() {
  errno = 0;
  if (!stream_.flush()) return Error("write");
  if (written_path_ == path_) return absl::OkStatus();
  std::error_code error;
  std::filesystem::rename(written_path_, path_, error);
  if (error) return absl::InvalidArgumentError(absl::StrCat("cannot write ", path_.string(), ": ", error.message()));
  stream_.close();
  return absl::OkStatus();
}

absl::Status OutputFile::Error(const char* what) const {
  return absl::InvalidArgumentError(
      absl::StrCat("cannot ", what, " ", path_.string(), ": ", errno != 0 ? std::strerror(errno) : "unknown reason"));
}

}  // namespace orbitune::cli
