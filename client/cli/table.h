// Columns of text, aligned.
#pragma once

#include <ostream>
#include <string>
#include <vector>

namespace orbitune::cli {

class Table {
 public:
  // A title beginning with '>' makes a column flush right (the '>' is not shown).
  explicit Table(std::vector<std::string> titles);

  // One cell per column.
  void AddRow(std::vector<std::string> cells);

  // Columns two spaces apart, no spaces at the end of a line.
  void Print(std::ostream& out) const;

 private:
  std::vector<bool> right_;
  std::vector<std::vector<std::string>> rows_;
};

// Characters (code points) of a UTF-8 text.
std::size_t DisplayWidth(const std::string& text);

}  // namespace orbitune::cli
