#include "service/rpc_error.h"

#include <grpcpp/support/status.h>
#include <gtest/gtest.h>

#include <new>

#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace fogbank::service {
namespace {

google::rpc::ErrorInfo info_of(const grpc::Status& status) {
  google::rpc::Status details;
  EXPECT_TRUE(details.ParseFromString(status.error_details()));
  EXPECT_EQ(details.code(), status.error_code());
  EXPECT_EQ(details.message(), status.error_message());
  google::rpc::ErrorInfo info;
  EXPECT_EQ(details.details_size(), 1);
  EXPECT_TRUE(details.details(0).UnpackTo(&info));
  EXPECT_EQ(info.domain(), "fogbank");
  return info;
}

TEST(RpcError, ASceneErrorBringsItsPlace) {
  const SceneError error(ErrorKind::unsupported, "UNKNOWN_PLUGIN",
                         {.file = "fog.xml", .line = 7, .element = "<bsdf type=\"velvet\">"},
                         "is not supported");
  const grpc::Status status = to_grpc_status(to_rpc_error(std::make_exception_ptr(error)));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNIMPLEMENTED);
  EXPECT_EQ(status.error_message(), "fog.xml:7: <bsdf type=\"velvet\">: is not supported");
  const google::rpc::ErrorInfo info = info_of(status);
  EXPECT_EQ(info.reason(), "UNKNOWN_PLUGIN");
  EXPECT_EQ(info.metadata().at("file"), "fog.xml");
  EXPECT_EQ(info.metadata().at("line"), "7");
}

TEST(RpcError, UntypedErrorsAreInternal) {
  const auto reason = [](const auto& error) {
    return info_of(to_grpc_status(to_rpc_error(std::make_exception_ptr(error)))).reason();
  };
  EXPECT_EQ(reason(std::runtime_error("x")), "INTERNAL_ERROR");
  EXPECT_EQ(reason(std::bad_alloc()), "OUT_OF_MEMORY");
  EXPECT_EQ(reason(42), "INTERNAL_ERROR");
}

// gRPC sends the message as a header and protobuf takes UTF-8 only, but messages quote hostile files.
TEST(RpcError, MessagesAreShortValidAndPrintable) {
  const std::string hostile = "\xff\xfe bad \xc3\x28 \x1b[31m \xf0\x9f\x8c\xab end";
  const grpc::Status status = to_grpc_status({grpc::StatusCode::INTERNAL, "X", hostile, {{"key", hostile}}});
  EXPECT_EQ(status.error_message(), "?? bad ?(  [31m \xf0\x9f\x8c\xab end");
  EXPECT_EQ(info_of(status).metadata().at("key"), status.error_message());
  const grpc::Status long_one = to_grpc_status({grpc::StatusCode::INTERNAL, "X", std::string(1 << 20, 'a')});
  EXPECT_LT(long_one.error_message().size(), 4096u);
}

}  // namespace
}  // namespace fogbank::service
