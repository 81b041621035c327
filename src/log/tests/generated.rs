//! `generated/` was made of `hydroline.proto` as it is; `tests/nightly generated` compiles it again and compares.
#![allow(clippy::unwrap_used)]

use sha2::{Digest, Sha256};
use std::path::Path;

#[test]
fn the_messages_in_the_tree_were_made_of_this_proto_file() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR"));
    let proto = std::fs::read(room.join("hydroline.proto")).unwrap();
    let digest: String = Sha256::digest(proto)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let made_of = std::fs::read_to_string(room.join("generated/hydroline.proto.sha256")).unwrap();
    assert_eq!(
        made_of.trim(),
        digest,
        "hydroline.proto has changed: run `cargo run --manifest-path src/log/generate/Cargo.toml` and commit src/log/generated"
    );
}
