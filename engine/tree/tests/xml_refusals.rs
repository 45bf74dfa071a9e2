//! What is wrong with a file is named, with its line and column, all of it at once.
#![cfg(feature = "xml")]

use sfg_tree::xml::{ImportOptions, import};

fn files(path: &str) -> Result<String, String> {
    match path {
        "self.xml" => Ok("<root BTCPP_format='4'>\n<include path='loop/a.xml'/></root>".to_owned()),
        "loop/a.xml" => Ok("<root BTCPP_format='4'>\n  <include path='./b.xml'/></root>".to_owned()),
        "loop/b.xml" => Ok("<root BTCPP_format='4'>\n  <include path='../loop/a.xml'/></root>".to_owned()),
        "bad.xml" => Ok("<root BTCPP_format='4'>\n<BehaviorTree ID='Bad'><A x='{ k }'/></BehaviorTree></root>".to_owned()),
        _ => Err("no such file".to_owned()),
    }
}

#[track_caller]
fn check_file(text: &str, expected: &[&str]) {
    let options = ImportOptions { load: &files, ..ImportOptions::default() };
    check_with(text, &options, expected);
}

#[track_caller]
fn check_with(text: &str, options: &ImportOptions<'_>, expected: &[&str]) {
    let found: Vec<String> = match import(text, options) {
        Ok(_) => Vec::new(),
        Err(problems) => problems.iter().map(ToString::to_string).collect(),
    };
    assert_eq!(found, expected);
}

/// `node` begins in line 3, column 1.
#[track_caller]
fn check(node: &str, expected: &str) {
    check_file(&format!("<root BTCPP_format='4'>\n<BehaviorTree ID='T'>\n{node}\n</BehaviorTree></root>"), &[expected]);
}

#[test]
fn names() {
    check("<A.b/>", "3:1: \"A.b\": a name cannot have '.'");
    check("<Action ID='open door'/>", "3:13: \"open door\": a name cannot have ' '");
    check("<Action ID='Root'/>", "3:13: \"Root\": this name is reserved");
    check("<root/>", "3:1: \"root\": this name is reserved");
    check("<Action/>", "3:1: \"Action\": the attribute \"ID\" is missing");
    check("<sequence><A/></sequence>", "3:1: \"sequence\": this name is reserved");
    check("<recover><A/></recover>", "3:1: \"recover\": this name is reserved");
    check("<A ID='x'/>", "3:4: \"ID\": the attribute is not allowed here");
    check("<A name='a&#127;'/>", "3:10: \"a\\u{7f}\": a name cannot have '\\u{7f}'");
    check("<A \u{e4}rm='1'/>", "3:4: \"\u{e4}rm\": a port begins with a letter from a to z");
    check("<A my.port='1'/>", "3:4: \"my.port\": a name cannot have '.'");
    check("<x:A xmlns:x='u'/>", "3:1: \"A\": a name cannot have ':'");
    check("<A xmlns:x='u' x:p='1'/>", "3:16: \"p\": a name cannot have ':'");
}

#[test]
fn names_of_version_3() {
    check("<SequenceStar><A/></SequenceStar>", "3:1: \"SequenceStar\": this is of BehaviorTree.CPP 3");
    check("<SubTreePlus ID='T'/>", "3:1: \"SubTreePlus\": this is of BehaviorTree.CPP 3");
    check("<Control ID='SequenceStar'><A/></Control>", "3:14: \"SequenceStar\": this is of BehaviorTree.CPP 3");
    check("<A __shared_blackboard='1'/>", "3:4: \"__shared_blackboard\": this is of BehaviorTree.CPP 3");
}

#[test]
fn keys() {
    let blanks = "blanks around the key \"{key}\"; write it without them";
    check("<A p='{key}  '/>", &format!("3:7: \"{{key}}  \": no blackboard key: {blanks}"));
    check("<A p='{a.b}'/>", "3:7: \"{a.b}\": no blackboard key: a dot in a key means a field of an entry here");
    let letters = "is no blackboard key; a key has letters, digits and underscores, and dots before fields";
    check("<A p='{two words}'/>", &format!("3:7: \"{{two words}}\": no blackboard key: \"{{two words}}\" {letters}"));
    check("<A p='{}'/>", &format!("3:7: \"{{}}\": no blackboard key: \"{{}}\" {letters}"));
    check(
        "<Sleep msec='{t}'/>",
        "3:14: \"{t}\": a key cannot stand here: the entry would hold milliseconds there and seconds here",
    );
    check(
        "<Precondition if='a' else='{s}'><A/></Precondition>",
        "3:28: \"{s}\": a key cannot stand here: the entry would hold a NodeStatus, which is a text here",
    );
    check("<UnsetBlackboard key='two words'/>", &format!("3:23: \"two words\": no blackboard key: \"{{two words}}\" {letters}"));
}

#[test]
fn values_of_built_in_nodes() {
    check(
        "<RetryUntilSuccessful num_attempts='3.5'><A/></RetryUntilSuccessful>",
        "3:37: \"3.5\": expected a whole number of 32 bits",
    );
    check("<Timeout msec='-1'><A/></Timeout>", "3:16: \"-1\": expected whole milliseconds from 0 to 4294967295");
    check(
        "<Precondition if='a' else='failure'><A/></Precondition>",
        "3:28: \"failure\": expected one of FAILURE, SUCCESS, SKIPPED, RUNNING",
    );
    check("<RunOnce then_skip='yes'><A/></RunOnce>", "3:21: \"yes\": expected true or false");
    check("<RateController hz='fast'><A/></RateController>", "3:21: \"fast\": expected a finite number");
    check("<LoopInt queue='1;x' value='{i}'><A/></LoopInt>", "3:17: \"1;x\": expected a whole number of 32 bits");
    check("<LoopInt queue='1' value='i'><A/></LoopInt>", "3:27: \"i\": expected a blackboard key such as \"{key}\"");
    check("<Sequence\n msec='1'><A/></Sequence>", "4:2: \"msec\": Sequence has no such port");
    check("<SubTree ID='T' _autoremap='yes'/>", "3:29: \"yes\": expected true or false");
}

#[test]
fn switches() {
    check("<Switch2 variable='{v}' case_1='a'><A/><B/><C/></Switch2>", "3:1: \"Switch2\": the port \"case_2\" must be given");
    check(
        "<Switch2 variable='{v}' case_1='a' case_2='b'><A/><B/></Switch2>",
        "3:1: \"Switch2\": expected one child a case and one for the rest, found 2",
    );
    check(
        "<Switch2 variable='{v}' case_1='a' case_2='b' case_3='c'><A/><B/><C/></Switch2>",
        "3:47: \"case_3\": Switch2 has no such port",
    );
    check_file(
        "<root BTCPP_format='4'><BehaviorTree ID='T'>\n<Switch2 variable='{v}' case_1='{x}' case_2='b'><A/><B/><C/></Switch2></BehaviorTree></root>",
        &[
            "2:1: \"Switch2\": the port \"case_1\" must be given",
            "2:33: \"{x}\": a key cannot stand here: the cases are constants",
        ],
    );
}

#[test]
fn children() {
    check("<SubTree ID='T'><A/></SubTree>", "3:1: \"SubTree\": expected no children of a use of a subtree, found 1");
    check("<Action ID='X'><A/></Action>", "3:1: \"Action\": expected no children, found 1");
    check("<Decorator ID='X'/>", "3:1: \"Decorator\": expected exactly one child, found 0");
    check("<Control ID='X'/>", "3:1: \"Control\": expected at least one child, found 0");
    check("", "2:1: \"BehaviorTree\": expected exactly one node in a tree, found 0");
    check("<A/><B/>", "2:1: \"BehaviorTree\": expected exactly one node in a tree, found 2");
}

#[test]
fn trees() {
    check("<SubTree ID='Tt'/>", "3:14: \"Tt\": unknown tree");
    let file = |inside: &str| format!("<root BTCPP_format='4'>\n{inside}</root>");
    check_file(
        &file("<BehaviorTree ID='T'><A/></BehaviorTree>\n<BehaviorTree ID='T'><A/></BehaviorTree>"),
        &["1:1: \"root\": no tree to run is named", "3:1: \"T\": this tree is defined twice"],
    );
    check_file(
        &file("<BehaviorTree><A/></BehaviorTree><BehaviorTree ID='T'><A/></BehaviorTree>"),
        &["1:1: \"root\": no tree to run is named", "2:1: \"BehaviorTree\": the attribute \"ID\" is missing"],
    );
    check_file(&file("<BehaviorTree ID='Sequence'><A/></BehaviorTree>"), &["2:19: \"Sequence\": this name is reserved"]);
    check_file(&file(""), &["1:1: \"root\": no tree to run is named"]);
    check_file(
        "<root BTCPP_format='4' main_tree_to_execute='X'><BehaviorTree ID='T'><A/></BehaviorTree></root>",
        &["1:46: \"X\": unknown tree"],
    );
}

#[test]
fn files_as_a_whole() {
    check_file("", &["1:1: \"\": not well-formed XML: the document does not have a root node"]);
    check_file("<root>\n<a></b></root>", &["2:4: \"</b></root>\": not well-formed XML: expected 'a' tag, not 'b'"]);
    check_file("<!DOCTYPE root><root/>", &["1:1: \"<!DOCTYPE root><root/>\": not well-formed XML: XML with DTD detected"]);
    check_file("<tree/>", &["1:1: \"tree\": a file of BehaviorTree.CPP has <root> around everything"]);
    check_file("<root BTCPP_format='3'/>", &["1:21: \"3\": this is of BehaviorTree.CPP 3"]);
    check_file("<root BTCPP_format='5'/>", &["1:21: \"5\": unknown BTCPP_format"]);
    let tree = "<BehaviorTree ID='T'><A/></BehaviorTree>";
    let unknown = "unknown element in <root>";
    check_file(
        &format!("<root BTCPP_format='4'>{tree}\n<BehaviourTree/></root>"),
        &[&format!("2:1: \"BehaviourTree\": {unknown}")],
    );
}

#[test]
fn includes() {
    let file = |include: &str| format!("<root BTCPP_format='4'><BehaviorTree ID='T'><A/></BehaviorTree>\n{include}</root>");
    let check = |include: &str, expected: &[&str]| check_file(&file(include), expected);
    check("<include ros_pkg='robot' path='a.xml'/>", &["2:19: \"robot\": files of ROS packages cannot be included"]);
    check("<include/>", &["2:1: \"include\": the attribute \"path\" is missing"]);
    check("<include path=''/>", &["2:1: \"include\": the attribute \"path\" is missing"]);
    check("<include path='none.xml'/>", &["2:16: \"none.xml\": cannot be included: no such file"]);
    let chain = "the file includes itself: self.xml -> loop/a.xml -> loop/b.xml -> loop/a.xml";
    check("<include path='self.xml'/>", &[&format!("loop/b.xml:2:18: \"../loop/a.xml\": {chain}")]);
}

#[test]
fn palettes() {
    let file = |inside: &str| {
        format!(
            "<root BTCPP_format='4' main_tree_to_execute='T'><BehaviorTree ID='T'><SubTree ID='S'/></BehaviorTree>\
             <BehaviorTree ID='S'><A/></BehaviorTree>\n<TreeNodesModel>{inside}</TreeNodesModel></root>"
        )
    };
    let check = |inside: &str, expected: &[&str]| check_file(&file(inside), expected);
    check("<Actoin ID='A'/>", &["2:17: \"Actoin\": unknown element in <TreeNodesModel>"]);
    check("<Action/>", &["2:17: \"Action\": the attribute \"ID\" is missing"]);
    check("<Action ID='A b'/>", &["2:29: \"A b\": a name cannot have ' '"]);
    check("<Action ID='A'><input_port/></Action>", &["2:32: \"input_port\": the attribute \"name\" is missing"]);
    check("<Action ID='A'><input_port name='ID'/></Action>", &["2:50: \"ID\": this name is reserved"]);
    check("<Action ID='A'><in name='x'/></Action>", &["2:32: \"in\": unknown element in <TreeNodesModel>"]);
    check("<SubTree ID='S'><input_port name='n'/></SubTree>", &["1:70: \"S\": the port \"n\" must be given"]);
    check(
        "<SubTree ID='S'/><SubTree ID='S'><input_port name='n' default='1'/></SubTree>",
        &["2:34: \"S\": this subtree has two different models"],
    );
    let key = "no blackboard key: a dot in a key means a field of an entry here";
    check("<SubTree ID='S'><input_port name='n' default='{a.b}'/></SubTree>", &[&format!("2:63: \"{{a.b}}\": {key}")]);
    check("</TreeNodesModel><TreeNodesModel>", &["2:34: \"TreeNodesModel\": more than 1 <TreeNodesModel> in a file"]);
}

#[test]
fn sizes() {
    let tree = |inside: &str| format!("<root BTCPP_format='4'><BehaviorTree ID='T'>\n{inside}</BehaviorTree></root>");
    let nested = |depth: usize| tree(&format!("{}<A/>{}", "<B>".repeat(depth - 1), "</B>".repeat(depth - 1)));
    check_file(&nested(256), &[]);
    check_file(&nested(257), &["2:769: \"A\": nested deeper than 256 nodes"]);
    check_file(&nested(100_000), &["2:769: \"B\": nested deeper than 256 nodes"]);
    let small = ImportOptions { n_bytes_max: 20, ..ImportOptions::default() };
    check_with("<root BTCPP_format='4'/>", &small, &["1:1: \"\": the files have more than 20 bytes"]);
    let attributes: String = (0..5000).map(|number| format!(" a{number}='1'")).collect();
    check_file(&tree(&format!("<A{attributes}/>")), &["2:39859: \"\": more than 4096 attributes of an element"]);
    let attributes: String = (0..5000).map(|number| format!(" a{number}='<'")).collect();
    check_file(&tree(&format!("<A{attributes}/>")), &["2:39859: \"\": more than 4096 attributes of an element"]);
    let many = tree(&"<A p='{'/><A p='{}'/>".repeat(5000));
    assert_eq!(import(&many, &ImportOptions::default()).err().map(|problems| problems.len()), Some(1000));
}

#[test]
fn mistakes_of_all_files_come_at_once() {
    check_file(
        "<root BTCPP_format='4' main_tree_to_execute='T'>\n<include path='bad.xml'/>\n<BehaviorTree ID='T'><Sequence>\n<A p='{ }'/>\n<SubTree ID='None'/></Sequence></BehaviorTree></root>",
        &[
            "4:7: \"{ }\": no blackboard key: \"{ }\" is no blackboard key; a key has letters, digits and underscores, and dots before fields",
            "5:14: \"None\": unknown tree",
            "bad.xml:2:30: \"{ k }\": no blackboard key: \"{ k }\" is no blackboard key; a key has letters, digits and underscores, and dots before fields",
        ],
    );
}

#[test]
fn warnings_do_not_refuse() {
    let text = "<root>\n<BehaviorTree ID='T'>\nhello <A _skipif='x'\n _onFailure='a && b < c'/></BehaviorTree></root>";
    let found: Vec<String> = match import(text, &ImportOptions::default()) {
        Ok(tree) => tree.warnings.iter().map(|warning| format!("{warning}; {}", warning.help)).collect(),
        Err(problems) => problems.iter().map(ToString::to_string).collect(),
    };
    assert_eq!(
        found,
        [
            "1:1: \"root\": BTCPP_format is missing; read as format 4; write <root BTCPP_format=\"4\">",
            "3:1: \"hello\": this has no effect; write a comment as <!-- ... -->",
            "3:10: \"_skipif\": this has no effect; did you mean \"_skipIf\"?",
            "4:16: \"&\": XML wants &amp; here; write &amp;",
            "4:17: \"&\": XML wants &amp; here; write &amp;",
            "4:21: \"<\": XML wants &lt; here; write &lt;",
        ]
    );
}
