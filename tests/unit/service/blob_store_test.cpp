#include "service/blob_store.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>

#include "service/limits.h"
#include "service/rpc_error.h"

namespace fogbank::service {
namespace {

namespace fs = std::filesystem;
using std::chrono::seconds;

class BlobStoreTest : public testing::Test {
 protected:
  BlobStoreTest() {
    std::string pattern = (fs::temp_directory_path() / "fogbank-blobs-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
  }
  ~BlobStoreTest() override { fs::remove_all(folder_); }

  /// Reason of the RpcError that `action` throws; "" when it throws none.
  template <typename Action>
  static std::string reason_of(Action action) {
    try {
      action();
    } catch (const RpcError& error) {
      return error.reason();
    }
    return "";
  }

  static void store(BlobStore& blobs, const std::string& bytes) {
    const auto upload = blobs.begin(sha256(bytes), static_cast<int64_t>(bytes.size()), 0);
    if (!upload->already_complete()) upload->append(bytes);
    upload->finish();
  }

  fs::path folder_;
};

TEST_F(BlobStoreTest, StoresWhatItsNameSays) {
  BlobStore blobs(folder_);
  EXPECT_EQ(blobs.query(sha256("abc")).committed_size, 0);
  store(blobs, "abc");
  store(blobs, "abc");
  EXPECT_TRUE(blobs.query(sha256("abc")).complete);
  const auto blob = blobs.find(sha256("abc"));
  ASSERT_TRUE(blob);
  EXPECT_EQ(blob->size, 3);
  std::ifstream file(blob->path);
  EXPECT_EQ(std::string(std::istreambuf_iterator<char>(file), {}), "abc");
}

TEST_F(BlobStoreTest, ResumesInAnotherLife) {
  const std::string bytes(1000, 'x');
  {
    BlobStore blobs(folder_);
    blobs.begin(sha256(bytes), 1000, 0)->append(bytes.substr(0, 400));
  }
  BlobStore blobs(folder_);
  EXPECT_EQ(blobs.query(sha256(bytes)).committed_size, 400);
  EXPECT_FALSE(blobs.query(sha256(bytes)).complete);
  EXPECT_EQ(reason_of([&] { blobs.begin(sha256(bytes), 1000, 399); }), "UPLOAD_OFFSET_MISMATCH");
  const auto upload = blobs.begin(sha256(bytes), 1000, 400);
  upload->append(bytes.substr(400));
  upload->finish();
  EXPECT_TRUE(blobs.query(sha256(bytes)).complete);
}

TEST_F(BlobStoreTest, WrongBytesAreDiscardedAndCanBeSentAnew) {
  BlobStore blobs(folder_);
  {
    const auto upload = blobs.begin(sha256("abc"), 3, 0);
    upload->append("abd");
    EXPECT_EQ(reason_of([&] { upload->finish(); }), "BLOB_HASH_MISMATCH");
  }
  EXPECT_EQ(blobs.query(sha256("abc")).committed_size, 0);
  store(blobs, "abc");
}

TEST_F(BlobStoreTest, OneWriterABlob) {
  BlobStore blobs(folder_);
  auto first = blobs.begin(sha256("abc"), 3, 0);
  EXPECT_EQ(reason_of([&] { blobs.begin(sha256("abc"), 3, 0); }), "UPLOAD_IN_PROGRESS");
  first.reset();
  EXPECT_EQ(reason_of([&] { blobs.begin(sha256("abc"), 3, 0); }), "");
}

TEST_F(BlobStoreTest, RefusesWhatIsNotOfItsKind) {
  BlobStore blobs(folder_);
  EXPECT_EQ(reason_of([&] { blobs.query("../../etc/passwd"); }), "INVALID_SHA256");
  EXPECT_EQ(reason_of([&] { blobs.begin(std::string(64, 'A'), 1, 0); }), "INVALID_SHA256");
  EXPECT_EQ(reason_of([&] { blobs.begin(sha256("x"), -1, 0); }), "INVALID_UPLOAD");
  EXPECT_EQ(reason_of([&] { blobs.begin(sha256("x"), limits::max_blob_bytes + 1, 0); }), "BLOB_TOO_LARGE");
  const auto upload = blobs.begin(sha256("abc"), 3, 0);
  EXPECT_EQ(reason_of([&] { upload->append(""); }), "INVALID_UPLOAD");
  EXPECT_EQ(reason_of([&] { upload->append("abcd"); }), "BLOB_SIZE_MISMATCH");
  EXPECT_EQ(reason_of([&] { upload->append("ab"); }), "");
  EXPECT_EQ(reason_of([&] { upload->finish(); }), "BLOB_SIZE_MISMATCH");
}

TEST_F(BlobStoreTest, ASymbolicLinkIsNoBlob) {
  BlobStore blobs(folder_);
  const std::string name = sha256("abc");
  fs::create_directories(folder_ / name.substr(0, 2));
  fs::create_symlink("/etc/passwd", folder_ / name.substr(0, 2) / name);
  EXPECT_FALSE(blobs.find(name));
}

TEST_F(BlobStoreTest, SweepKeepsWhatIsUsedOrYoung) {
  BlobStore blobs(folder_);
  store(blobs, "used");
  store(blobs, "unused");
  blobs.begin(sha256("partial"), 7, 0)->append("par");
  const auto writing = blobs.begin(sha256("writing"), 7, 0);
  writing->append("wri");
  blobs.sweep({sha256("used")}, seconds(3600), seconds(3600));
  EXPECT_TRUE(blobs.find(sha256("unused")));
  EXPECT_EQ(blobs.query(sha256("partial")).committed_size, 3);
  blobs.sweep({sha256("used")}, seconds(0), seconds(0));
  EXPECT_TRUE(blobs.find(sha256("used")));
  EXPECT_FALSE(blobs.find(sha256("unused")));
  EXPECT_EQ(blobs.query(sha256("partial")).committed_size, 0);
  EXPECT_EQ(blobs.query(sha256("writing")).committed_size, 3);
}

}  // namespace
}  // namespace fogbank::service
