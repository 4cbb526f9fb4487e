#include "base/sha256.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/text_file.hpp"

namespace kdl_calibration {
Sha256::Sha256() { sha256_init(&state_); }

void Sha256::add(std::string_view bytes) {
  // NOLINTNEXTLINE(cppcoreguidelines-pro-type-reinterpret-cast): nettle takes bytes without a sign
  sha256_update(&state_, bytes.size(), reinterpret_cast<const std::uint8_t*>(bytes.data()));
}

std::string Sha256::hexadecimal() {
  std::array<std::uint8_t, SHA256_DIGEST_SIZE> digest{};
  sha256_digest(&state_, digest.size(), digest.data());
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string result;
  for (const unsigned byte : digest) {
    result += kDigits[byte >> 4U];
    result += kDigits[byte & 0xFU];
  }
  return result;
}

std::string sha256(std::string_view bytes) {
  Sha256 digest;
  digest.add(bytes);
  return digest.hexadecimal();
}

std::string sha256_of(std::FILE* file, const std::string& source) {
  constexpr std::size_t kPiece = std::size_t{1} << 16U;
  std::vector<char> piece(kPiece);
  Sha256 digest;
  for (std::size_t count = kPiece; count == kPiece;) {
    count = read_bytes(file, piece.data(), kPiece, source);
    digest.add({piece.data(), count});
  }
  return digest.hexadecimal();
}

std::string sha256_of_file(const std::filesystem::path& path) {
  return sha256_of(open_file(path).get(), path.string());
}

}  // namespace kdl_calibration
