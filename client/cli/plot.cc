#include "client/cli/plot.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/format.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

constexpr double kWidth = 720;
constexpr double kLeft = 70;
constexpr double kRight = 14;
constexpr double kAbove = 10;  // the plot, beside the legend
constexpr double kLegendRow = 17;
constexpr double kBottom = 46;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr int kMostDecades = 10;  // of a logarithmic axis, from its top

struct Tick {
  double at = 0;      // in [0, 1] of the axis
  std::string label;  // SVG
};

// One axis: values to [0, 1], and where its ticks are.
class Axis {
 public:
  Axis(double low, double high, bool logarithmic) : log_(logarithmic) {
    if (!(low <= high)) low = high = log_ ? 1 : 0;
    low_ = Scale(low);
    high_ = Scale(high);
    if (log_) {
      const double margin = std::max(0.04 * (high_ - low_), 0.05);
      low_ -= margin;
      high_ += margin;
    } else if (low_ == high_) {
      const double margin = low_ == 0 ? 1 : std::abs(low_) / 10;
      low_ -= margin;
      high_ += margin;
    }
  }

  double operator()(double value) const { return (Scale(value) - low_) / (high_ - low_); }

  std::vector<Tick> Ticks() const { return log_ ? Decades() : Steps(); }

 private:
  double Scale(double value) const { return log_ ? std::log10(value) : value; }

  // Powers of ten; of an axis with hardly any, their double and fivefold, too.
  std::vector<Tick> Decades() const {
    std::vector<Tick> ticks;
    const bool few = high_ - low_ < 2;
    const int step = std::max(1, static_cast<int>(std::lround((high_ - low_) / 6)));
    for (double exponent = std::floor(low_); exponent <= high_; exponent += step) {
      for (const double times : {1.0, 2.0, 5.0}) {
        const double at = (exponent + std::log10(times) - low_) / (high_ - low_);
        if (at < 0 || at > 1 || (times > 1 && !few)) continue;
        ticks.push_back(
            {at, few ? Human(times * std::pow(10, exponent))
                     : absl::StrFormat("10<tspan dy=\"-5\" font-size=\"9\">%d</tspan>", static_cast<int>(exponent))});
      }
    }
    return ticks;
  }

  std::vector<Tick> Steps() const {
    const double rough = (high_ - low_) / 6;
    const double power = std::pow(10, std::floor(std::log10(rough)));
    double step = 10 * power;
    for (const double nice : {5.0, 2.0, 1.0}) {
      if (nice * power >= rough) step = nice * power;
    }
    std::vector<Tick> ticks;
    for (double i = std::ceil(low_ / step - 1e-9); i * step <= high_ + 1e-9 * step; ++i) {
      ticks.push_back({(i * step - low_) / (high_ - low_), Human(i == 0 ? 0 : i * step, 6)});
    }
    return ticks;
  }

  const bool log_;
  double low_ = 0;
  double high_ = 1;
};

struct Range {
  double low = kInfinity;
  double high = -kInfinity;

  void Add(double value) {
    low = std::min(low, value);
    high = std::max(high, value);
  }
};

bool Drawn(const Plot& plot, const PlotPoint& p) {
  return std::isfinite(p.x) && std::isfinite(p.y) && (!plot.log_y || p.y > 0) && (!plot.x_end || p.x <= *plot.x_end);
}

class Drawing {
 public:
  explicit Drawing(const Plot& plot)
      : plot_(plot), top_(kAbove + LegendHeight(plot)), ranges_(RangesOf(plot)), x_(MakeX()), y_(MakeY()) {}

  std::string Render(int points_per_line) {
    absl::StrAppendFormat(&svg_, "<svg viewBox=\"0 0 %g %d\" role=\"img\" aria-label=\"%s\">\n", kWidth, plot_.height,
                          EscapeXml(plot_.title));
    DrawAxes();
    for (const PlotSeries& series : plot_.series) DrawSeries(series, points_per_line);
    for (const PlotLevel& level : plot_.levels) DrawLevel(level);
    DrawLegend();
    return absl::StrCat(svg_, "</svg>\n");
  }

 private:
  struct Ranges {
    Range x;
    Range y;
  };

  static Ranges RangesOf(const Plot& plot) {
    Ranges ranges;
    for (const PlotSeries& series : plot.series) {
      for (const PlotPoint& p : series.points) {
        if (!Drawn(plot, p)) continue;
        ranges.x.Add(p.x);
        ranges.y.Add(p.y);
      }
    }
    for (const PlotLevel& level : plot.levels) {
      if (!plot.log_y || level.y > 0) ranges.y.Add(level.y);
    }
    return ranges;
  }

  Axis MakeX() const { return {ranges_.x.low, plot_.x_end.value_or(ranges_.x.high), false}; }

  Axis MakeY() const {
    if (!plot_.log_y) return {std::min(0.0, ranges_.y.low), ranges_.y.high, false};
    return {std::max(ranges_.y.low, ranges_.y.high * std::pow(10, -kMostDecades)), ranges_.y.high, true};
  }

  double bottom() const { return plot_.height - kBottom; }
  double X(double value) const { return kLeft + x_(value) * (kWidth - kLeft - kRight); }
  // A value below the axis is drawn at its foot.
  double Y(double value) const { return bottom() - std::max(0.0, y_(value)) * (bottom() - top_); }

  void DrawAxes() {
    for (const Tick& tick : x_.Ticks()) {
      const double x = kLeft + tick.at * (kWidth - kLeft - kRight);
      absl::StrAppendFormat(&svg_, "<line class=\"grid\" x1=\"%.1f\" x2=\"%.1f\" y1=\"%g\" y2=\"%g\"/>", x, x, top_,
                            bottom());
      absl::StrAppendFormat(&svg_, "<text x=\"%.1f\" y=\"%g\" text-anchor=\"middle\">%s</text>\n", x, bottom() + 16,
                            tick.label);
    }
    for (const Tick& tick : y_.Ticks()) {
      const double y = bottom() - tick.at * (bottom() - top_);
      absl::StrAppendFormat(&svg_, "<line class=\"grid\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>", kLeft,
                            kWidth - kRight, y, y);
      absl::StrAppendFormat(&svg_, "<text x=\"%g\" y=\"%.1f\" text-anchor=\"end\">%s</text>\n", kLeft - 6, y + 4,
                            tick.label);
    }
    absl::StrAppendFormat(&svg_, "<path class=\"axis\" d=\"M%g %gV%gH%g\"/>\n", kLeft, top_, bottom(), kWidth - kRight);
    absl::StrAppendFormat(&svg_, "<text class=\"label\" x=\"%g\" y=\"%d\" text-anchor=\"middle\">%s</text>\n",
                          (kLeft + kWidth - kRight) / 2, plot_.height - 8, EscapeXml(plot_.x_label));
    const double middle = (top_ + bottom()) / 2;
    absl::StrAppendFormat(
        &svg_, "<text class=\"label\" transform=\"translate(14 %g) rotate(-90)\" text-anchor=\"middle\">%s</text>\n",
        middle, EscapeXml(plot_.y_label));
  }

  void DrawLevel(const PlotLevel& level) {
    if (plot_.log_y && !(level.y > 0)) return;
    absl::StrAppendFormat(&svg_, "<line class=\"%s\" x1=\"%g\" x2=\"%g\" y1=\"%.1f\" y2=\"%.1f\"/>\n",
                          EscapeXml(level.style), kLeft, kWidth - kRight, Y(level.y), Y(level.y));
  }

  void DrawSeries(const PlotSeries& series, int points_per_line) {
    std::vector<PlotPoint> points = series.points;
    for (PlotPoint& p : points) {
      if (!Drawn(plot_, p)) p.y = std::numeric_limits<double>::quiet_NaN();
    }
    std::string path;
    bool pen_down = false;
    for (const PlotPoint& p : Thin(points, points_per_line)) {
      if (std::isnan(p.y)) {
        pen_down = false;
        continue;
      }
      absl::StrAppendFormat(&path, "%c%.1f %.1f", pen_down ? 'L' : 'M', X(p.x), Y(p.y));
      pen_down = true;
    }
    if (!path.empty()) absl::StrAppend(&svg_, "<path class=\"", EscapeXml(series.style), "\" d=\"", path, "\"/>\n");
  }

  // In rows above the plot.
  void DrawLegend() {
    double x = kLeft;
    double y = kLegendRow - 4;
    const auto entry = [&](const std::string& style, const std::string& title) {
      if (title.empty()) return;
      const double width = LegendWidth(title);
      if (x > kLeft && x + width > kWidth - kRight) {
        x = kLeft;
        y += kLegendRow;
      }
      absl::StrAppendFormat(&svg_, "<line class=\"%s\" x1=\"%g\" x2=\"%g\" y1=\"%g\" y2=\"%g\"/>", EscapeXml(style), x,
                            x + 20, y - 4, y - 4);
      absl::StrAppendFormat(&svg_, "<text x=\"%g\" y=\"%g\">%s</text>\n", x + 25, y, EscapeXml(title));
      x += width;
    };
    for (const PlotSeries& series : plot_.series) entry(series.style, series.title);
    for (const PlotLevel& level : plot_.levels) entry(level.style, level.title);
  }

  // As the text is about as wide as its characters are many.
  static double LegendWidth(const std::string& title) { return 45 + 6.5 * static_cast<double>(DisplayWidth(title)); }

  // The rows that DrawLegend needs.
  static double LegendHeight(const Plot& plot) {
    double x = kLeft;
    double rows = 0;
    const auto entry = [&](const std::string& title) {
      if (title.empty()) return;
      if (rows == 0 || (x > kLeft && x + LegendWidth(title) > kWidth - kRight)) {
        x = kLeft;
        ++rows;
      }
      x += LegendWidth(title);
    };
    for (const PlotSeries& series : plot.series) entry(series.title);
    for (const PlotLevel& level : plot.levels) entry(level.title);
    return rows * kLegendRow;
  }

  const Plot& plot_;
  const double top_;
  const Ranges ranges_;
  const Axis x_;
  const Axis y_;
  std::string svg_;
};

}  // namespace

std::string EscapeXml(const std::string& text) {
  std::string escaped;
  for (const char c : Printable(text)) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      case '\'':
        escaped += "&#39;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

std::vector<PlotPoint> Thin(const std::vector<PlotPoint>& points, int limit) {
  if (points.size() <= static_cast<std::size_t>(limit)) return points;
  const std::size_t stretches = static_cast<std::size_t>(std::max(1, limit / 2));
  std::vector<PlotPoint> thinned = {points.front()};
  for (std::size_t s = 0; s < stretches; ++s) {
    const std::size_t begin = 1 + s * (points.size() - 2) / stretches;
    const std::size_t end = 1 + (s + 1) * (points.size() - 2) / stretches;
    std::size_t least = begin, greatest = begin;
    bool gap = false;
    for (std::size_t i = begin; i < end; ++i) {
      gap = gap || std::isnan(points[i].y);
      if (std::isnan(points[i].y)) continue;
      if (!(points[least].y <= points[i].y)) least = i;
      if (!(points[greatest].y >= points[i].y)) greatest = i;
    }
    if (begin == end) continue;
    thinned.push_back(points[std::min(least, greatest)]);
    if (gap) thinned.push_back({points[begin].x, std::numeric_limits<double>::quiet_NaN()});
    if (least != greatest) thinned.push_back(points[std::max(least, greatest)]);
  }
  thinned.push_back(points.back());
  return thinned;
}

std::string RenderSvg(const Plot& plot, int points_per_line) { return Drawing(plot).Render(points_per_line); }

}  // namespace orbitune::cli
