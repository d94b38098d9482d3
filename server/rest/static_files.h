// The dashboard's files, as npm has built them: read from a directory when they are asked for, so that a new build
// needs no new start.
#pragma once

#include <string>

#include "server/rest/http.h"

namespace orbitune::rest {

// Thread-safe. Reads the disk, so it may block.
class StaticFiles {
 public:
  // directory: need not exist (yet).
  explicit StaticFiles(std::string directory) : directory_(std::move(directory)) {}

  // The reply to GET `path`, percent-encoded. "/" and pages of the dashboard's own (no extension, and a browser asks)
  // get index.html; without the directory, a page that says how to build it. FILE.br and FILE.gz beside FILE are sent
  // to who accepts them. 304 where If-None-Match has the ETag, 404 where there is no such file.
  HttpReply Get(const HttpRequest& request, const std::string& path) const;

 private:
  const std::string directory_;
};

}  // namespace orbitune::rest
