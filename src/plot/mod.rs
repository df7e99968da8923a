//! Figures that a paper could print, as SVG and PNG from one description, without any of the system's fonts.
//!
//! A [`Chart`] is data with axes: lines, markers, bars. A [`Figure`] is the page beneath: lines, areas, discs, text and
//! pictures in order, for what is no chart. [`job`] draws what a job holds.
//!
//! ```
//! use glowtree::plot::{Axis, Chart, Series, Style};
//!
//! let mut chart = Chart::new("Error against cost", Axis::log("CPU time (s)"), Axis::log("relative RMS error"));
//! chart.series.push(Series::new("hierarchical", Style::LineMarkers, vec![[1.2, 0.05], [4.0, 0.02], [21.0, 0.01]]));
//! let folder = tempfile::tempdir()?;
//! let files = chart.write(&folder.path().join("errors"))?;
//! assert!(files[0].ends_with("errors.svg") && files[1].ends_with("errors.png"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod axis;
pub mod canvas;
pub mod chart;
pub mod job;
pub mod key;
pub mod palette;
mod panel;
mod series;

pub use axis::Axis;
pub use canvas::{Anchor, Colour, Figure, Pen, Rect, Text};
pub use chart::{Chart, Series, Style};
