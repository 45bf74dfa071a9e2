//! SRDF: what a URDF does not say about groups of joints and about which links may touch.

use crate::error::KinematicsError;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A group of joints.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Name.
    pub name: String,
    /// Base and tip link of its chain, if it is one.
    pub chain: Option<(String, String)>,
    /// Joints that it names.
    pub joints: Vec<String>,
    /// Links that it names.
    pub links: Vec<String>,
}

/// A semantic description.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Srdf {
    /// Groups in the order of the file.
    pub groups: Vec<Group>,
    /// Named poses: group and name to joint values, radians or metres.
    pub states: BTreeMap<(String, String), BTreeMap<String, f64>>,
    /// Pairs of links that are not looked at for touching each other.
    pub disabled_pairs: BTreeSet<(String, String)>,
}

impl Srdf {
    /// Reads a file.
    ///
    /// # Errors
    /// [`KinematicsError::ReadFile`], [`KinematicsError::Srdf`] with line and column.
    pub fn load(path: &Path) -> Result<Self, KinematicsError> {
        let text = std::fs::read_to_string(path).map_err(|source| KinematicsError::ReadFile { path: path.to_owned(), source })?;
        Self::parse(&text).map_err(|message| KinematicsError::Srdf { path: path.to_owned(), message })
    }

    fn parse(text: &str) -> Result<Self, String> {
        let document = roxmltree::Document::parse(text).map_err(|error| error.to_string())?;
        let attribute = |node: roxmltree::Node<'_, '_>, name: &str| {
            node.attribute(name).map(str::to_owned).ok_or_else(|| {
                let at = document.text_pos_at(node.range().start);
                format!("{}:{}: <{}> has no {name:?}", at.row, at.col, node.tag_name().name())
            })
        };
        let root = document.root_element();
        if root.tag_name().name() != "robot" {
            return Err(format!("expected <robot>, found <{}>", root.tag_name().name()));
        }
        let mut srdf = Self::default();
        for node in root.children().filter(roxmltree::Node::is_element) {
            match node.tag_name().name() {
                "group" => {
                    let mut group = Group { name: attribute(node, "name")?, chain: None, joints: Vec::new(), links: Vec::new() };
                    for member in node.children().filter(roxmltree::Node::is_element) {
                        match member.tag_name().name() {
                            "chain" => group.chain = Some((attribute(member, "base_link")?, attribute(member, "tip_link")?)),
                            "joint" => group.joints.push(attribute(member, "name")?),
                            "link" => group.links.push(attribute(member, "name")?),
                            _ => {}
                        }
                    }
                    srdf.groups.push(group);
                }
                "group_state" => {
                    let mut values = BTreeMap::new();
                    for joint in node.children().filter(|child| child.has_tag_name("joint")) {
                        let text = attribute(joint, "value")?;
                        let value = text.trim().parse::<f64>().ok().filter(|value| value.is_finite()).ok_or_else(|| {
                            let at = document.text_pos_at(joint.range().start);
                            format!("{}:{}: value {text:?} is no number", at.row, at.col)
                        })?;
                        values.insert(attribute(joint, "name")?, value);
                    }
                    srdf.states.insert((attribute(node, "group")?, attribute(node, "name")?), values);
                }
                "disable_collisions" => {
                    srdf.disabled_pairs.insert((attribute(node, "link1")?, attribute(node, "link2")?));
                }
                _ => {}
            }
        }
        Ok(srdf)
    }

    /// The group called `name`.
    #[must_use]
    pub fn group(&self, name: &str) -> Option<&Group> {
        self.groups.iter().find(|group| group.name == name)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    #[test]
    fn groups_poses_and_pairs_are_read() {
        let srdf = Srdf::parse(
            r#"<robot name="r"><group name="arm"><chain base_link="a" tip_link="b"/></group><group name="hand"><joint name="j"/></group>
            <group_state group="arm" name="ready"><joint name="j1" value=" -0.5 "/></group_state>
            <disable_collisions link1="a" link2="b" reason="Adjacent"/></robot>"#,
        )
        .unwrap();
        assert_eq!(srdf.group("arm").unwrap().chain, Some(("a".to_owned(), "b".to_owned())));
        assert_eq!(srdf.group("hand").unwrap().joints, ["j"]);
        assert_eq!(srdf.states[&("arm".to_owned(), "ready".to_owned())]["j1"], -0.5);
        assert!(srdf.disabled_pairs.contains(&("a".to_owned(), "b".to_owned())) && srdf.group("leg").is_none());
    }

    #[test]
    fn mistakes_have_a_place() {
        let mistake = |text: &str| Srdf::parse(text).unwrap_err();
        assert_eq!(mistake("<robot>\n <group/></robot>"), "2:2: <group> has no \"name\"");
        assert!(
            mistake("<robot><group_state group=\"a\" name=\"b\"><joint name=\"j\" value=\"NaN\"/></group_state></robot>")
                .ends_with("value \"NaN\" is no number")
        );
        assert!(mistake("<urdf/>").contains("expected <robot>") && mistake("<robot><a></robot>").contains("1:"));
    }
}
