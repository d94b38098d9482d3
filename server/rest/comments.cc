#include "server/rest/comments.h"

#include <string_view>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "google/protobuf/descriptor.pb.h"
#include "orbitune/v1/sources.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::DescriptorProto;
using google::protobuf::EnumDescriptor;
using google::protobuf::EnumDescriptorProto;
using google::protobuf::FileDescriptorProto;
using google::protobuf::ServiceDescriptorProto;

std::vector<int> Within(std::vector<int> path, int field_number, int index) {
  path.push_back(field_number);
  path.push_back(index);
  return path;
}

std::vector<int> PathOf(const Descriptor* type) {
  const Descriptor* outer = type->containing_type();
  return outer == nullptr ? Within({}, FileDescriptorProto::kMessageTypeFieldNumber, type->index())
                          : Within(PathOf(outer), DescriptorProto::kNestedTypeFieldNumber, type->index());
}

std::vector<int> PathOf(const EnumDescriptor* type) {
  const Descriptor* outer = type->containing_type();
  return outer == nullptr ? Within({}, FileDescriptorProto::kEnumTypeFieldNumber, type->index())
                          : Within(PathOf(outer), DescriptorProto::kEnumTypeFieldNumber, type->index());
}

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
  for (const FileDescriptorProto& file : files.file()) {
    for (const auto& location : file.source_code_info().location()) {
      std::string text;
      Append(location.leading_comments(), text);
      Append(location.trailing_comments(), text);
      if (!text.empty()) comments_[{file.name(), {location.path().begin(), location.path().end()}}] = std::move(text);
    }
  }
}

std::string Comments::Of(const Descriptor* message) const { return At({message->file()->name(), PathOf(message)}); }

std::string Comments::Of(const google::protobuf::FieldDescriptor* field) const {
  return At({field->file()->name(),
             Within(PathOf(field->containing_type()), DescriptorProto::kFieldFieldNumber, field->index())});
}

std::string Comments::Of(const EnumDescriptor* type) const { return At({type->file()->name(), PathOf(type)}); }

std::string Comments::Of(const google::protobuf::EnumValueDescriptor* value) const {
  return At(
      {value->file()->name(), Within(PathOf(value->type()), EnumDescriptorProto::kValueFieldNumber, value->index())});
}

std::string Comments::Of(const google::protobuf::MethodDescriptor* method) const {
  const auto service = Within({}, FileDescriptorProto::kServiceFieldNumber, method->service()->index());
  return At({method->file()->name(), Within(service, ServiceDescriptorProto::kMethodFieldNumber, method->index())});
}

std::string Comments::OfFile(const google::protobuf::FileDescriptor* file) const {
  return At({file->name(), {FileDescriptorProto::kSyntaxFieldNumber}});
}

std::string Comments::At(const Place& place) const {
  const auto found = comments_.find(place);
  return found == comments_.end() ? std::string() : found->second;
}

}  // namespace orbitune::rest
