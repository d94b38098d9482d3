// Line plots as inline SVG: axes with units and ticks, linear or logarithmic; colours come from the page's style sheet.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace orbitune::cli {

struct PlotPoint {
  double x = 0;
  double y = 0;  // NaN, or not above 0 on a logarithmic axis: a gap
};

struct PlotSeries {
  std::string style;              // class of the line, e.g. "before"
  std::string title;              // in the legend; empty: not there
  std::vector<PlotPoint> points;  // in the order of x
};

struct PlotLevel {
  double y = 0;
  std::string style;
  std::string title;
};

struct Plot {
  std::string title;    // for those who cannot see it
  std::string x_label;  // with its unit
  std::string y_label;
  bool log_y = false;
  std::optional<double> x_end;     // nothing is drawn beyond
  std::vector<PlotSeries> series;  // drawn in this order
  std::vector<PlotLevel> levels;   // horizontal lines over the whole width
  int height = 300;                // of 720
};

// points_per_line: about so many are drawn of each; of what is thinned, the extremes stay.
std::string RenderSvg(const Plot& plot, int points_per_line = 600);

// Text as it stands in XML and HTML, in attributes too; what XML cannot hold is left out.
std::string EscapeXml(const std::string& text);

// At most about `limit` points of `points`: the first and the last, and of every stretch between the least and the
// greatest y, in their order. A gap stays one.
std::vector<PlotPoint> Thin(const std::vector<PlotPoint>& points, int limit);

}  // namespace orbitune::cli
