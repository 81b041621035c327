use super::*;

/// Messages of all, files, and messages of each topic.
type Counts = (Option<u64>, Vec<String>, Vec<(String, Option<u64>)>);

fn counts(text: &str) -> Counts {
    let yaml = Yaml::parse(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    let own = yaml.get("rosbag2_bagfile_information").unwrap();
    let files = own.get("relative_file_paths").unwrap().list().iter();
    let topics = own.get("topics_with_message_count").unwrap().list().iter();
    (
        own.get("message_count").and_then(Yaml::count),
        files.map(|f| f.text().unwrap().to_owned()).collect(),
        topics
            .map(|t| {
                let name = t.get("topic_metadata").unwrap().get("name").unwrap();
                let count = t.get("message_count").and_then(Yaml::count);
                (name.text().unwrap().to_owned(), count)
            })
            .collect(),
    )
}

#[test]
fn the_same_account_is_read_as_every_writer_lays_it_out() {
    let cpp = r#"rosbag2_bagfile_information:
  version: 5
  storage_identifier: sqlite3
  duration:
    nanoseconds: 24960000000
  message_count: 1250
  topics_with_message_count:
    - topic_metadata:
        name: /pose
        type: geometry_msgs/msg/PoseStamped
        offered_qos_profiles: "- history: 3\n  depth: 0\n  reliability: 1"
      message_count: 625
    - topic_metadata:
        name: "/cmd/surge: a"
        offered_qos_profiles:
          - history: unknown
            depth: 0
      message_count: 625
  compression_format: ""
  relative_file_paths:
    - a_0.db3
    - a 1.db3
  files:
    - path: a_0.db3
      message_count: 3
  custom_data: ~
"#;
    let python = r#"# by a script
---
rosbag2_bagfile_information:
  message_count: 1250   # all
  relative_file_paths:
  - a_0.db3
  - 'a 1.db3'
  topics_with_message_count:
  - message_count: 625
    topic_metadata:
      name: /pose
      offered_qos_profiles: "- history: 3\n  depth: 0\n  reliability: 1\n  durability\
        : 2\n  # no remark"
  - message_count: 625
    topic_metadata: {name: '/cmd/surge: a', type: x}
    note: |
      message_count: 7
       - none
"#;
    let json = r#"{"rosbag2_bagfile_information": {"message_count": 1250,
 "relative_file_paths": ["a_0.db3", "a 1.db3"], "topics_with_message_count": [
   {"topic_metadata": {"name": "/pose", "q": []}, "message_count": 625},
   {"topic_metadata": {"name": "/cmd/surge: a"}, "message_count": 625}]}}"#;
    let flow = "rosbag2_bagfile_information: {message_count: 1250, relative_file_paths: [a_0.db3, a 1.db3],\n  topics_with_message_count: [{topic_metadata: {name: /pose}, message_count: 625},\n  {topic_metadata: {name: \"/cmd/surge: a\"}, message_count: 625}]}\n";
    let expected = (
        Some(1250),
        vec!["a_0.db3".to_owned(), "a 1.db3".to_owned()],
        vec![
            ("/pose".to_owned(), Some(625)),
            ("/cmd/surge: a".to_owned(), Some(625)),
        ],
    );
    for text in [cpp, python, json, flow, &cpp.replace('\n', "\r\n")] {
        assert_eq!(counts(text), expected, "{text}");
    }
}

#[test]
fn tags_and_aliases_cost_a_text_its_own_length() {
    let text = "a: &x !t [1, 2]\nb: *x\nc: !!str 3\nd: &y {e: *x}\n? [f]\n: 4\n";
    let yaml = Yaml::parse(text).unwrap();
    assert_eq!(yaml.get("a").unwrap().list().len(), 2);
    assert_eq!(yaml.get("b").unwrap(), &Yaml::List(Vec::new()));
    assert_eq!(yaml.get("c").and_then(Yaml::count), Some(3));
    // Each list holds the one before it ten times: 10^30 elements if they were followed.
    let mut laughs = "a0: &a0 [x]\n".to_owned();
    for n in 0..30 {
        let before = format!("*a{n}, ").repeat(10);
        laughs += &format!("a{}: &a{} [{before}]\n", n + 1, n + 1);
    }
    let yaml = Yaml::parse(&laughs).unwrap();
    assert_eq!(
        yaml.get("a30").unwrap().list(),
        [const { Yaml::List(Vec::new()) }; 10]
    );
    let prefix = "x".repeat(1000);
    let error = Yaml::parse(&format!("%TAG !a! {prefix}\n---\n- !a!b 1\n"));
    assert!(error.unwrap_err().contains("%TAG"));
}

#[test]
fn no_more_is_read_ahead_than_an_account_takes() {
    let list = |length: usize| format!("[{}]\n", "x,".repeat(length / 2));
    let yaml = Yaml::parse(&list(AHEAD_MAX / 2)).unwrap();
    assert_eq!(yaml.list().len(), AHEAD_MAX / 4);
    for text in [
        list(AHEAD_MAX + 100),
        format!("a: 1\nb: \"{}\"", "x".repeat(AHEAD_MAX + 100)),
        format!("a: 1\nb: |\n{}", " x\n".repeat(AHEAD_MAX)),
    ] {
        let error = Yaml::parse(&text).unwrap_err();
        assert!(error.contains("what follows is too long"), "{error}");
    }
    // A longer file is read, if no part of it is.
    let long = "- a: 1\n".repeat(AHEAD_MAX / 4);
    assert_eq!(Yaml::parse(&long).unwrap().list().len(), AHEAD_MAX / 4);
}

#[test]
fn what_is_no_yaml_is_an_error_with_its_line() {
    let deep = "- ".repeat(1000);
    for (text, words) in [
        ("a: 1\nb\n", "line 3: "),
        ("a: 1\nb: 2\nc: [1, 2\n", "line 4"),
        ("a: \"x\n", "line 1"),
        (deep.as_str(), "nested too deep"),
        ("a:\n    b: 1\n  c: 2\n", "line 3"),
        ("a: 1\n---\nb: 2\n", "line 3: a second"),
    ] {
        let error = Yaml::parse(text).unwrap_err();
        assert!(error.contains(words), "{text:?}: {error}");
    }
    for text in [
        "",
        "[[[",
        "{a: {b",
        "- - -\n -",
        ":",
        "]",
        "{]}",
        "'",
        "a: &",
        "|",
        "\u{e4}: {\u{e4}",
    ] {
        let _ = Yaml::parse(text);
    }
    let _ = Yaml::parse(&"[".repeat(100_000));
    let _ = Yaml::parse(&"{a: ".repeat(100_000));
}
