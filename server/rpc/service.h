// A gRPC service whose methods are the API's: each handler is one line, Call or Stream with its own name.
#pragma once

#include <grpcpp/grpcpp.h>

#include <memory>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "core/base/check.h"
#include "server/api/api.h"
#include "server/api/error.h"

namespace orbitune {

inline grpc::Status ToGrpc(const absl::Status& status) {
  if (status.ok()) return grpc::Status::OK;
  const google::rpc::Status details = ToRpcStatus(status);
  return {static_cast<grpc::StatusCode>(status.code()), details.message(), details.SerializeAsString()};
}

// A server stream fed from the API. Lives until the call is done. The feed gives its end once, in answer to Next, which
// is asked when no write is in flight: one StartWrite at a time, one Finish, and no lock.
template <typename Response>
class StreamReactor final : public grpc::ServerWriteReactor<Response> {
 public:
  explicit StreamReactor(std::shared_ptr<Feed> feed) : feed_(std::move(feed)) { Next(); }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      feed_->End(absl::CancelledError("the watcher is gone"));
      sent_ = items_.size();
    }
    Next();
  }
  void OnCancel() override { feed_->End(absl::CancelledError("cancelled by the watcher")); }
  void OnDone() override { delete this; }

 private:
  // What is taken from the feed at a time.
  static constexpr std::size_t kTogether = 16;

  void Next() {
    if (sent_ < items_.size()) return Write();
    feed_->Next(kTogether, [this](Feed::Batch batch) {
      if (batch.end) return this->Finish(ToGrpc(*batch.end));
      items_ = std::move(batch.items);
      sent_ = 0;
      Write();
    });
  }

  void Write() { this->StartWrite(static_cast<const Response*>(&items_[sent_++]->message())); }

  const std::shared_ptr<Feed> feed_;
  std::vector<FeedItem> items_;
  std::size_t sent_ = 0;
};

// Service: the generated one, v1::TuningService.
template <typename Service>
class ApiService : public Service::CallbackService {
 protected:
  using Context = grpc::CallbackServerContext;
  using Reactor = grpc::ServerUnaryReactor;

  // api: outlives this.
  explicit ApiService(Api& api) : api_(api) {}

  template <typename Request, typename Response>
  Reactor* Call(const char* method, Context* context, const Request* request, Response* response) {
    Reactor* reactor = context->DefaultReactor();
    api_.Call(
        Find<Request>(method), *request, response, [context] { return context->IsCancelled(); },
        [reactor](const absl::Status& status) { reactor->Finish(ToGrpc(status)); });
    return reactor;
  }

  template <typename Response, typename Request>
  grpc::ServerWriteReactor<Response>* Stream(const char* method, const Request* request) {
    return new StreamReactor<Response>(Find<Request>(method).open(*request));
  }

 private:
  template <typename Request>
  const Method& Find(const char* name) const {
    const Method* method = api_.methods().Find(absl::StrCat(Service::service_full_name(), ".", name));
    ORBITUNE_CHECK(method != nullptr && method->request->GetDescriptor() == Request::descriptor());
    return *method;
  }

  Api& api_;
};

}  // namespace orbitune
