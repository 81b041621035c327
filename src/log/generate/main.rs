//! `cargo run --manifest-path src/log/generate/Cargo.toml` writes `generated/`: what `hydroline.proto` compiles to, its
//! descriptors, and the digest of the file that both were made of. With `--check` it compares instead.

use prost::Message;
use sha2::{Digest, Sha256};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let check = std::env::args().any(|word| word == "--check");
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let proto = room.join("hydroline.proto");
    // protox: a protobuf compiler in Rust, so that no protoc has to be installed.
    let descriptors = protox::compile([&proto], [&room])?;
    let out = std::env::temp_dir().join(format!("hydroline-log-generate-{}", std::process::id()));
    std::fs::create_dir_all(&out)?;
    let described = descriptors.encode_to_vec();
    prost_build::Config::new()
        // Ordered maps: the same message must always give the same bytes.
        .btree_map(["."])
        .out_dir(&out)
        .compile_fds(descriptors)?;
    let code = std::fs::read(out.join("hydroline.rs"))?;
    std::fs::remove_dir_all(&out)?;
    let digest: String = Sha256::digest(std::fs::read(&proto)?)
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let mut old = Vec::new();
    for (name, bytes) in [
        ("hydroline.rs", code),
        ("hydroline.fds", described),
        ("hydroline.proto.sha256", format!("{digest}\n").into_bytes()),
    ] {
        let path = room.join("generated").join(name);
        if std::fs::read(&path).ok().as_deref() == Some(&bytes) {
            continue;
        }
        old.push(name);
        if !check {
            std::fs::write(&path, bytes)?;
        }
    }
    match (check, old.is_empty()) {
        (true, false) => Err(format!(
            "src/log/generated is not what hydroline.proto compiles to ({}): run this without --check and commit",
            old.join(", ")
        )
        .into()),
        _ => Ok(()),
    }
}
