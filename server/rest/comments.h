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

  // Of a message, field, enum, value, service or method; empty where it has none.
  template <typename Descriptor>
  std::string Of(const Descriptor* descriptor) const {
    std::vector<int> path;
    descriptor->GetLocationPath(&path);
    return At(FileOf(descriptor)->name(), path);
  }

  // What the file begins with.
  std::string OfFile(const google::protobuf::FileDescriptor* file) const;

 private:
  template <typename Descriptor>
  static const google::protobuf::FileDescriptor* FileOf(const Descriptor* descriptor) {
    return descriptor->file();
  }
  static const google::protobuf::FileDescriptor* FileOf(const google::protobuf::EnumValueDescriptor* value) {
    return value->type()->file();
  }

  std::string At(const std::string& file, const std::vector<int>& path) const;

  std::map<std::pair<std::string, std::vector<int>>, std::string> comments_;  // by file and place in it
};

}  // namespace orbitune::rest
