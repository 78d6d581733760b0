//! What the targets have in common. To run one: `cargo +nightly fuzz run pjlink`.

/// Feeds `bytes` to the parser of that name.
pub fn parse(name: &str, bytes: &[u8]) {
    for (found, parser) in rig::devices::parsers() {
        if found == name {
            parser(bytes);
            return;
        }
    }
    panic!("no parser {name}");
}

/// Feeds `bytes` to the reader of materials of that name.
pub fn read(name: &str, bytes: &[u8]) {
    for (found, reader) in material::readers() {
        if found == name {
            // Whether they are a material is not asked here.
            let _ = reader(bytes);
            return;
        }
    }
    panic!("no reader {name}");
}
