//! Configuration: layers of TOML, read into structs, with all mistakes reported at once.
//!
//! Later layers win: a struct's `Default`, a parameter file, a table in the launch file, `--set`.
//! Tables are merged key by key, anything else is replaced. Numbers are finite: `nan` and `inf` are
//! refused everywhere.
//!
//! ```
//! use node::config::{Layers, Parameters, Report, Setting};
//!
//! #[derive(Debug, Default, serde::Deserialize)]
//! #[serde(default, deny_unknown_fields)]
//! struct Config {
//!     proportional_gain: f64,
//! }
//!
//! impl Parameters for Config {
//!     fn check(&self, report: &mut Report<'_>) {
//!         if self.proportional_gain < 0.0 {
//!             report.refuse("proportional_gain", "must not be negative", "such as 2.0");
//!         }
//!     }
//! }
//!
//! let setting: Setting = "proportional_gian=2".parse().unwrap();
//! let errors = Layers::new().settings([&setting]).parse::<Config>().unwrap_err();
//! assert_eq!(errors.iter().next().unwrap().help, "did you mean `proportional_gain`?");
//! ```

mod captured;
mod error;
mod layers;
mod likely;
mod listed;
mod missing;
mod parse;
mod reader;
mod rejection;
mod repair;
mod report;
mod setting;
mod source;
mod value;

#[cfg(test)]
mod tests;

pub use captured::{FileName, Table};
pub use error::{Error, Errors, Place};
pub use layers::Layers;
pub use likely::{likely, suggestion, suggestion_or};
pub use listed::{Listable, Listed};
pub(crate) use listed::{changed, value};
pub use report::{Parameters, Report};
pub use setting::Setting;
