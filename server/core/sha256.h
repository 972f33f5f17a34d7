// SHA-256 (FIPS 180-4), through OpenSSL: names of blobs, fingerprints of scenes.
#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <string_view>

namespace fogbank {

/// Incremental hash.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;

  void update(const void* data, size_t size);
  void update(std::string_view text) { update(text.data(), text.size()); }
  /// 64 lower-case hexadecimal digits of all bytes so far; the object can't be used afterwards.
  std::string finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Hash of `bytes` as 64 lower-case hexadecimal digits.
std::string sha256(std::string_view bytes);

}  // namespace fogbank
