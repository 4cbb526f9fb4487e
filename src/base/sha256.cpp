#include "base/sha256.hpp"

#include <openssl/evp.h>

#include <array>
#include <cstddef>
#include <memory>
#include <new>
#include <vector>

#include "base/text_file.hpp"

namespace kdl_calibration {
namespace {

class Digest {
public:
  Digest() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) {
    if (!context_ || EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) != 1) {
      throw std::bad_alloc();
    }
  }

  void add(const char* bytes, std::size_t count) { EVP_DigestUpdate(context_.get(), bytes, count); }

  std::string hexadecimal() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
    unsigned size = 0;
    EVP_DigestFinal_ex(context_.get(), digest.data(), &size);
    constexpr std::string_view kDigits = "0123456789abcdef";
    std::string result;
    for (unsigned i = 0; i < size; ++i) {
      result += kDigits[digest[i] >> 4U];
      result += kDigits[digest[i] & 0xFU];
    }
    return result;
  }

private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

std::string sha256(std::string_view bytes) {
  Digest digest;
  digest.add(bytes.data(), bytes.size());
  return digest.hexadecimal();
}

std::string sha256_of_file(const std::filesystem::path& path) {
  constexpr std::size_t kPiece = std::size_t{1} << 20U;
  const File file = open_file(path);
  std::vector<char> piece(kPiece);
  Digest digest;
  for (std::size_t count = kPiece; count == kPiece;) {
    count = read_bytes(file.get(), piece.data(), kPiece, path.string());
    digest.add(piece.data(), count);
  }
  return digest.hexadecimal();
}

}  // namespace kdl_calibration
