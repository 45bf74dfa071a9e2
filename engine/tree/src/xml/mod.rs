//! BehaviorTree.CPP v4 files: [`import`] makes a [`TreeSpec`] of one, [`export`] writes one, [`export_models`] writes the palette.
//!
//! Both ways are exact or refused: what one side cannot say comes back as an [`XmlProblem`] that names it, all of them at once.
//! The nodes that both sides have, with their ports, are in `names.rs`; every other node is the application's and keeps its name.
//!
//! ```
//! use sfg_tree::xml;
//!
//! let text = r#"<root BTCPP_format="4"><BehaviorTree ID="Pick">
//!     <Timeout msec="1500"><Grasp object="{cup}"/></Timeout>
//! </BehaviorTree></root>"#;
//! let tree = xml::import(text, &xml::ImportOptions::default()).map_err(|problems| problems[0].to_string())?;
//! assert_eq!(tree.spec.root.children[0].ports[0].name, "object");
//! let place = tree.places[tree.spec.root.children[0].location as usize];
//! assert_eq!((place.line, place.column), (2, 26));
//! # Ok::<(), String>(())
//! ```

mod export;
mod file;
mod import;
mod link;
mod models;
mod names;
mod problem;
mod text;
mod value;

pub use export::export;
pub use import::import;
#[cfg(feature = "groot")]
pub(crate) use models::type_label;
pub use models::{XmlModel, XmlPort, export_models};
#[cfg(feature = "groot")]
pub(crate) use names::find_ours;
pub use problem::{XmlFault, XmlPlace, XmlProblem};

#[cfg(feature = "groot")]
pub(crate) use value::Kind;

use crate::spec::TreeSpec;

/// What [`import`] may do.
pub struct ImportOptions<'a> {
    /// The tree to run; else the one that the file names in `main_tree_to_execute`, else its only one.
    pub main_tree: Option<String>,
    /// The text of a file that `<include path="...">` names. The path is relative to the first file, with `/` and without `..` where
    /// that is possible.
    pub load: &'a dyn Fn(&str) -> Result<String, String>,
    /// Size of all files together.
    pub n_bytes_max: usize,
    /// Nesting of elements below a `BehaviorTree`; BehaviorTree.CPP allows as much.
    pub depth_max: usize,
}

impl Default for ImportOptions<'_> {
    fn default() -> Self {
        Self { main_tree: None, load: &no_files, n_bytes_max: 16 << 20, depth_max: 256 }
    }
}

fn no_files(_path: &str) -> Result<String, String> {
    Err("files cannot be included here".to_owned())
}

/// A tree out of a file.
#[derive(Clone, Debug, Default)]
pub struct ImportedTree {
    /// The tree. Keys that nothing writes are allowed, as BehaviorTree.CPP does; every subtree is open.
    pub spec: TreeSpec,
    /// Where a `location` of the spec was written. The first place is the beginning of the first file.
    pub places: Vec<Place>,
    /// The files that a [`Place`] counts: the first is the text given and has no name, the others have the path they were loaded by.
    pub files: Vec<String>,
    /// The palette of the file.
    pub models: Vec<XmlModel>,
    /// What was read but is probably not meant so.
    pub warnings: Vec<XmlProblem>,
}

/// A character in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Which of [`ImportedTree::files`].
    pub file: u32,
    /// From 1.
    pub line: u32,
    /// In characters, from 1.
    pub column: u32,
}
