#include "server/rest/comments.h"

#include <string_view>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "google/protobuf/descriptor.pb.h"
#include "orbitune/v1/sources.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

// The lines of a comment as one.
void Append(const std::string& comment, std::string& out) {
  for (const std::string_view line : Split(comment, '\n')) {
    const std::string_view text = Trim(line);
    if (!text.empty()) absl::StrAppend(&out, out.empty() ? "" : " ", std::string(text));
  }
}

}  // namespace

Comments::Comments() {
  google::protobuf::FileDescriptorSet files;
  ORBITUNE_CHECK(files.ParseFromArray(v1::kSources, static_cast<int>(v1::kSourcesSize)));
  for (const google::protobuf::FileDescriptorProto& file : files.file()) {
    for (const auto& location : file.source_code_info().location()) {
      std::string text;
      Append(location.leading_comments(), text);
      Append(location.trailing_comments(), text);
      if (!text.empty()) comments_[{file.name(), {location.path().begin(), location.path().end()}}] = std::move(text);
    }
  }
}

std::string Comments::OfFile(const google::protobuf::FileDescriptor* file) const {
  return At(file->name(), {google::protobuf::FileDescriptorProto::kSyntaxFieldNumber});
}

std::string Comments::At(const std::string& file, const std::vector<int>& path) const {
  const auto found = comments_.find({file, path});
  return found == comments_.end() ? std::string() : found->second;
}

}  // namespace orbitune::rest
