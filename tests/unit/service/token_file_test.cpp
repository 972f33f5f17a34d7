#include "service/token_file.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "core/sha256.h"
#include "service/rpc_error.h"

namespace fogbank::service {
namespace {

class TokensOnDisk : public ::testing::Test {
 protected:
  TokensOnDisk()
      : path_(std::filesystem::temp_directory_path() / ("token_file_test." + std::to_string(::getpid()))) {}
  ~TokensOnDisk() override { std::filesystem::remove(path_); }

  void write(const std::string& text) const { std::ofstream(path_) << text; }
  static std::string entry(const std::string& id, const std::string& secret, const std::string& expires,
                           const std::string& revoked) {
    return R"({"id": ")" + id + R"(", "sha256": ")" + sha256(secret) +
           R"(", "tenant": "studio", "scopes": ["render"], "created": 1, "expires": )" + expires +
           R"(, "revoked": )" + revoked + "}";
  }
  static std::string file(const std::string& entries) {
    return R"({"version": 1, "tokens": [)" + entries + "]}";
  }
  std::string reason(const std::string& token) const {
    TokenFile tokens(path_);
    try {
      tokens.identify(token);
      return "";
    } catch (const RpcError& error) {
      return error.reason();
    }
  }

  std::filesystem::path path_;
};

TEST_F(TokensOnDisk, KnowItsOwn) {
  write(file(entry("a1", "se_cret", "null", "null")));
  TokenFile tokens(path_);
  const Identity identity = tokens.identify("fogbank_a1_se_cret");
  EXPECT_EQ(identity.tenant, "studio");
  EXPECT_EQ(identity.scopes, std::set<Scope>{Scope::render});
  EXPECT_EQ(identity.by, "a1");
}

TEST_F(TokensOnDisk, RefuseEverythingElse) {
  write(file(entry("a1", "secret", "null", "null") + "," + entry("b2", "other", "5", "null") + "," +
             entry("c3", "third", "null", "7")));
  for (const char* token : {"", "fogbank_", "fogbank_a1", "fogbank_a1_", "fogbank_a1_Secret",
                            "fogbank_a1_other", "fogbank_zz_secret", "a1_secret", "fogbank__secret"}) {
    EXPECT_EQ(reason(token), "TOKEN_INVALID") << token;
  }
  EXPECT_EQ(reason("fogbank_b2_other"), "TOKEN_EXPIRED");
  EXPECT_EQ(reason("fogbank_c3_third"), "TOKEN_REVOKED");
  // What has ended is told to its owner only.
  EXPECT_EQ(reason("fogbank_c3_wrong"), "TOKEN_INVALID");
}

TEST_F(TokensOnDisk, ADamagedFileLetsNobodyIn) {
  for (const std::string& text :
       {std::string("{"), std::string("{}"), file("{}"), std::string(R"({"version": 2, "tokens": []})"),
        R"({"version": 1, "tokens": [)" + entry("a1", "secret", "\"soon\"", "null") + "]}"}) {
    write(text);
    EXPECT_EQ(reason("fogbank_a1_secret"), "TOKEN_INVALID") << text;
  }
  std::filesystem::remove(path_);
  EXPECT_EQ(reason("fogbank_a1_secret"), "TOKEN_INVALID");
}

TEST(TenantName, IsAFoldersNameThatLeadsNowhereElse) {
  for (const char* name : {"a", "studio-2", "0", "abcdefghijklmnopqrstuvwxyz012345"})
    EXPECT_TRUE(is_tenant_name(name));
  for (const char* name : {"", "-a", "A", "a/b", "..", ".", "a.b", "a b", "a\n", "\xc3\xa9",
                           "abcdefghijklmnopqrstuvwxyz0123456"}) {
    EXPECT_FALSE(is_tenant_name(name)) << name;
  }
}

}  // namespace
}  // namespace fogbank::service
