//! `generated/` holds what `hydroline.proto` compiles to.
//!
//! After a change of `hydroline.proto`: `HYDROLINE_GENERATE=1 cargo test -p hydroline-log --test generated`, then commit both.
#![allow(clippy::unwrap_used)]

use prost::Message;
use std::path::Path;

#[test]
fn the_messages_in_the_tree_are_those_of_the_proto_file() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    // protox: a protobuf compiler in Rust, so that no protoc has to be installed.
    let descriptors = protox::compile([room.join("hydroline.proto")], [room]).unwrap();
    let bytes = descriptors.encode_to_vec();
    let out = tempfile::tempdir().unwrap();
    prost_build::Config::new()
        // Ordered maps: the same message must always give the same bytes.
        .btree_map(["."])
        .out_dir(out.path())
        .compile_fds(descriptors)
        .unwrap();
    let made = std::fs::read_to_string(out.path().join("hydroline.rs")).unwrap();
    let generated = room.join("generated");
    if std::env::var_os("HYDROLINE_GENERATE").is_some() {
        std::fs::write(generated.join("hydroline.rs"), &made).unwrap();
        std::fs::write(generated.join("hydroline.fds"), &bytes).unwrap();
    }
    let same = std::fs::read_to_string(generated.join("hydroline.rs")).unwrap() == made
        && std::fs::read(generated.join("hydroline.fds")).unwrap() == bytes;
    assert!(
        same,
        "src/log/generated is not what hydroline.proto compiles to: run `HYDROLINE_GENERATE=1 cargo test -p hydroline-log --test generated` and commit the result"
    );
}
