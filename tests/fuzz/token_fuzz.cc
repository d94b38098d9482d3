// What callers send as a token.
#include "server/access/secret.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

void Token(std::string_view input) {
  static const Secret secret = Secret::New();
  Expect(!HasDigest(input, secret.digest), "nobody guesses a token");
  const auto id = SecretId(input);
  if (!id) return;
  Expect(id->size() == 8 && input.find(*id) != input.npos, "the id of a token is part of it");
}

const Registration kToken("token", Token);

}  // namespace
}  // namespace orbitune::fuzz
