//! Compiles `log/hydroline.proto` with a pure-Rust protoc, so that no tool has to be installed.

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed=src/log/hydroline.proto");
    let descriptors = protox::compile(["src/log/hydroline.proto"], ["src/log"])?;
    let out = std::path::PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("hydroline.fds"), prost_build_encode(&descriptors))?;
    // Ordered maps: the same message must always give the same bytes.
    prost_build::Config::new()
        .btree_map(["."])
        .compile_fds(descriptors)?;
    Ok(())
}

fn prost_build_encode(descriptors: &impl prost::Message) -> Vec<u8> {
    descriptors.encode_to_vec()
}
