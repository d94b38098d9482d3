// The campaigns' part of the SQLite store: the same file, the same writer, the same readers.
#pragma once

#include "storage/campaign_store.h"
#include "storage/sqlite_reader_pool.h"
#include "storage/sqlite_writer.h"

namespace orbitune {

class SqliteCampaignStore final : public CampaignStore {
 public:
  // writing: the writer's connection, used in its operations only. All outlive this, which queues nothing that is not
  // answered before the writer ends.
  SqliteCampaignStore(Connection& writing, SqliteWriter& writer, SqliteReaderPool& readers)
      : writing_(writing), writer_(writer), readers_(readers) {}

  void CreateCampaign(NewCampaign campaign, Written done) override;
  void ExtendCampaign(CampaignExtension extension, Written done) override;
  void AppendMemberEnded(const std::string& id, std::int64_t seq, const MemberEnded& ended, Done done) override;
  void ChangeState(const std::string& id, std::int64_t seq, CampaignStateChange change, Done done) override;
  void EndCampaign(const std::string& id, std::int64_t seq, CampaignEnd end, Done done) override;
  void DeleteCampaign(const std::string& id, Done done) override;

  absl::StatusOr<std::optional<CampaignRecord>> FindRequest(const std::string& request_id,
                                                            const std::string& request_digest) const override;
  absl::StatusOr<CampaignRecord> GetCampaign(const std::string& id) const override;
  absl::StatusOr<std::vector<CampaignRecord>> ListCampaigns(const CampaignQuery& query) const override;
  absl::StatusOr<std::vector<CampaignRecord>> ListUnfinishedCampaigns() const override;
  absl::StatusOr<std::vector<CampaignMember>> ListMembers(const std::string& id, MemberId after,
                                                          int limit) const override;
  absl::StatusOr<std::vector<CampaignEvent>> ListCampaignEvents(const std::string& id, std::int64_t after_seq,
                                                                int limit) const override;

 private:
  template <typename Apply>
  void QueueWritten(Apply apply, Written done);
  void Refuse(const absl::Status& fault, Written done);
  template <typename Apply>
  void Queue(Apply apply, Done done, bool refusable = false);

  Connection& writing_;
  SqliteWriter& writer_;
  SqliteReaderPool& readers_;
};

}  // namespace orbitune
