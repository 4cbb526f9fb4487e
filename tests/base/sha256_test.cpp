// Against the examples of FIPS 180-4 and of its validation system.

#include "base/sha256.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::sha256_test {
namespace {

TEST(Sha256, GivesThePublishedDigests) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1'000'000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(Sha256, OfPiecesIsThatOfTheWholeAndStartsAnew) {
  Sha256 hash;
  for (const char* text : {"abc", "another one"}) {
    for (const char* letter = text; *letter != '\0'; ++letter) {
      hash.add({letter, 1});
      hash.add("");
    }
    EXPECT_EQ(hash.hexadecimal(), sha256(text));
  }
  EXPECT_EQ(hash.hexadecimal(), sha256(""));
}

// Files are read in pieces of 64 KiB: below, at and above the length of one, and of two.
TEST(Sha256, OfAFileIsThatOfItsBytes) {
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "kdl_calibration_sha256_test";
  constexpr std::size_t kPiece = 65536;
  for (const std::size_t size : {std::size_t{0}, std::size_t{3}, kPiece - 1, kPiece, kPiece + 1, 2 * kPiece}) {
    std::string bytes(size, '\0');
    for (std::size_t i = 0; i < size; ++i) {
      bytes[i] = static_cast<char>(i * 2654435761U >> 13U);
    }
    std::ofstream(file, std::ios::binary | std::ios::trunc) << bytes;
    EXPECT_EQ(sha256_of_file(file), sha256(bytes)) << size;
  }
  std::filesystem::remove(file);
  EXPECT_THROW(sha256_of_file(file), InputError);
}

}  // namespace
}  // namespace kdl_calibration::sha256_test
