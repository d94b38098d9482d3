// Local files: JSON messages in, tables out. Errors name the file and the reason.
#pragma once

#include <filesystem>
#include <fstream>
#include <ostream>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "google/protobuf/message.h"

namespace orbitune::cli {

absl::StatusOr<std::string> ReadTextFile(const std::string& path);

// A message in proto3 JSON; unknown fields are errors. name: of the text, for errors.
absl::Status ParseJson(const std::string& text, const std::string& name, google::protobuf::Message* message);

// Both in one.
absl::Status ReadJsonFile(const std::string& path, google::protobuf::Message* message);

// A file that appears whole or not at all: written under another name beside it, and renamed by Commit().
// A path that is there and no regular file (a device, a pipe) is written to directly.
class OutputFile {
 public:
  explicit OutputFile(const std::string& path);
  ~OutputFile();  // without Commit() nothing stays
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  // Whether it could be opened.
  absl::Status status() const { return status_; }
  std::ostream& stream() { return stream_; }
  absl::Status Commit();

 private:
  absl::Status Error(const char* what) const;

  std::filesystem::path path_;
  std::filesystem::path written_path_;
  absl::Status status_;
  std::ofstream stream_;
};

}  // namespace orbitune::cli
