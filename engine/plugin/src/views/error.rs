//! What can be wrong with a value from the other side of the boundary.

use sfg_plugin_abi as abi;

/// Why a value from the other side cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The other side was built for an older, shorter struct.
    #[error("{what} has {size} bytes, at least {expected} are needed")]
    TooShort {
        /// Which struct.
        what: &'static str,
        /// Its size as stated.
        size: u32,
        /// The size this side reads.
        expected: u32,
    },
    /// A pointer is null.
    #[error("{what} is null")]
    Null {
        /// Which pointer.
        what: &'static str,
    },
    /// A text is not UTF-8.
    #[error("{what} is not UTF-8")]
    NotText {
        /// Which text.
        what: &'static str,
    },
    /// An integer stands for nothing known.
    #[error("{what} {value} is unknown")]
    UnknownValue {
        /// Which field.
        what: &'static str,
        /// Its value.
        value: u32,
    },
    /// A number is NaN or infinite.
    #[error("{what} is not finite")]
    NotFinite {
        /// Which field.
        what: &'static str,
    },
    /// A quaternion is no rotation.
    #[error("the quaternion of {what} has norm {norm:.6}, not 1")]
    NotUnit {
        /// Which pose.
        what: &'static str,
        /// Its norm.
        norm: f64,
    },
    /// A number is outside its range.
    #[error("{what} is {value}, outside [{low}, {high}]")]
    OutOfRange {
        /// Which field.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Smallest allowed.
        low: f64,
        /// Largest allowed.
        high: f64,
    },
    /// A candidate has more to say than the boundary carries.
    #[error(
        "score term {name:?}: at most {} terms with names of at most {} bytes cross the boundary",
        abi::TERMS_CAPACITY,
        abi::TERM_NAME_BYTES
    )]
    TermDoesNotFit {
        /// The first term that does not fit.
        name: String,
    },
}
