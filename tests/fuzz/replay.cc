// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// In place of libFuzzer, where the compiler hasn't got it: feeds a target the files in the folders
// it is given. With --directives it feeds each file once for every word in it, with the word
// replaced by directives of printf: a library that takes text of a file for a format ends here.
#include <fstream>
#include <iterator>

#include "tests/fuzz/fuzz.h"
#include "tests/support/directives.h"

namespace {

void feed(const std::string& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

}  // namespace

int main(int argc, char** argv) {
  int files = 0;
  bool directives = false;
  for (int i = 1; i < argc; ++i) {
    if (std::string_view(argv[i]) == "--directives") directives = true;
    if (argv[i][0] == '-') continue;  // the others are meant for libFuzzer
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::cout << entry.path().string() << std::endl;  // before a crash
      std::ifstream in(entry.path(), std::ios::binary);
      const std::string bytes(std::istreambuf_iterator<char>(in), {});
      if (directives) {
        soilvdb::test::with_directives(bytes, feed);
      } else {
        feed(bytes);
      }
      ++files;
    }
  }
  return files > 0 ? 0 : 1;
}
