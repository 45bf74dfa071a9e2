//! The files of the page, embedded in the program.

/// A file: its name, its media type, its text.
pub(crate) struct Asset {
    pub(crate) name: &'static str,
    pub(crate) media_type: &'static str,
    pub(crate) text: &'static str,
}

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";

macro_rules! assets {
    ($($media_type:ident: $($name:literal),+;)+) => {
        &[$($(Asset { name: $name, media_type: $media_type, text: include_str!(concat!("../page/", $name)) }),+),+]
    };
}

const ASSETS: &[Asset] = assets! {
    HTML: "index.html";
    STYLE: "style.css", "views.css";
    SCRIPT: "main.js", "run.js", "timeline.js", "tree.js", "blackboard.js", "decision.js", "stages.js", "compare.js", "keys.js",
        "control.js", "panel.js", "link.js", "html.js",
        "scene3d.js", "cameras.js", "synergy.js", "dom.js", "mathx.js", "shapes.js", "shaders.js", "gl.js", "palette.js", "robot.js",
        "camera.js", "scene_parts.js", "candidates3d.js", "png16.js";
};

/// The file at a path of the address: `/` is the page itself.
pub(crate) fn asset(path: &str) -> Option<&'static Asset> {
    let name = match path.trim_start_matches('/') {
        "" => "index.html",
        name => name,
    };
    ASSETS.iter().find(|asset| asset.name == name)
}
