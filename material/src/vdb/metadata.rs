//! Named values of a file and of its grids.

/// A named list, in the order in which it is written.
pub(super) type Metadata = Vec<(&'static str, Value)>;

/// What a name may stand for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Text(String),
    Truth(bool),
    Count(i64),
    Voxel([i32; 3]),
}

/// A text with its length before it.
pub(super) fn put_text(out: &mut Vec<u8>, text: &str) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

/// A list with its length before it.
pub(super) fn put(out: &mut Vec<u8>, metadata: &Metadata) {
    out.extend((metadata.len() as u32).to_le_bytes());
    for (name, value) in metadata {
        put_text(out, name);
        let (kind, bytes) = match value {
            Value::Text(text) => ("string", text.as_bytes().to_vec()),
            Value::Truth(truth) => ("bool", vec![u8::from(*truth)]),
            Value::Count(count) => ("int64", count.to_le_bytes().to_vec()),
            Value::Voxel(voxel) => ("vec3i", voxel.map(i32::to_le_bytes).concat()),
        };
        put_text(out, kind);
        out.extend((bytes.len() as u32).to_le_bytes());
        out.extend(bytes);
    }
}
