// What the proto files say of their services, messages and fields, for the description of the API: compiled descriptors
// have no comments, so that the build keeps those beside them.
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "google/protobuf/descriptor.h"

namespace orbitune::rest {

class Comments {
 public:
  Comments();

  // Empty where nothing is said.
  std::string Of(const google::protobuf::Descriptor* message) const;
  std::string Of(const google::protobuf::FieldDescriptor* field) const;
  std::string Of(const google::protobuf::EnumDescriptor* type) const;
  std::string Of(const google::protobuf::EnumValueDescriptor* value) const;
  std::string Of(const google::protobuf::MethodDescriptor* method) const;
  // What the file begins with.
  std::string OfFile(const google::protobuf::FileDescriptor* file) const;

 private:
  using Place = std::pair<std::string, std::vector<int>>;  // file, and path as in SourceCodeInfo

  std::string At(const Place& place) const;

  std::map<Place, std::string> comments_;
};

}  // namespace orbitune::rest
