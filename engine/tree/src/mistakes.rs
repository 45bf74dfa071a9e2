//! Every mistake of a tree as one error, for `?`.

use crate::problem::BuildError;
use crate::registry::Registry;
use crate::spec::TreeSpec;
use crate::tree::Tree;
use std::fmt;

/// Every mistake of a tree, shown one a line with its help.
#[derive(Clone, Debug, PartialEq)]
pub struct BuildErrors(pub Vec<BuildError>);

impl fmt::Display for BuildErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (error_idx, error) in self.0.iter().enumerate() {
            if error_idx > 0 {
                f.write_str("\n")?;
            }
            write!(f, "{error}")?;
            if let Some(help) = &error.help {
                write!(f, " ({help})")?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for BuildErrors {}

impl<C> Registry<C> {
    /// A tree, checked as a whole, as [`Registry::build`]; takes a bare node, too.
    ///
    /// # Errors
    /// Every mistake of `spec`, in the order of its nodes.
    pub fn tree(&self, spec: impl Into<TreeSpec>) -> Result<Tree<C>, BuildErrors> {
        self.build(&spec.into()).map_err(BuildErrors)
    }
}
