// One grid of the multigrid hierarchy; this text stands before every kernel that works on one.
//
// Conductances stand on faces: face_x holds nx + 1 a row, the first below cell 0 and the last above
// the last cell, and face_y and face_z likewise. Those on the block's surface are its boundary
// conductances, and what lies outside counts as 0, so that a boundary needs no formula of its own.
// A field holds `quads` vectors of four lanes a cell.

struct Level {
    cells: vec3<u32>,
    quads: u32,
    coarse: vec3<u32>, // cells of the next level
    planes: u32,       // planes along z that an invocation goes through
    shift: vec3<u32>,  // 1 along the axes that the next level halves, else 0
    unused: u32,
}

@group(0) @binding(0) var<uniform> level: Level;
@group(0) @binding(1) var<storage, read> face_x: array<f32>;
@group(0) @binding(2) var<storage, read> face_y: array<f32>;
@group(0) @binding(3) var<storage, read> face_z: array<f32>;
@group(0) @binding(4) var<storage, read> absorption: array<f32>; // μ times the cell's volume

fn cell_at(place: vec3<u32>) -> u32 {
    return (place.z * level.cells.y + place.y) * level.cells.x + place.x;
}

// The face below a cell along each axis, and the one above it.
fn faces_below(place: vec3<u32>) -> vec3<u32> {
    let n = level.cells;
    return vec3(
        (place.z * n.y + place.y) * (n.x + 1u) + place.x,
        (place.z * (n.y + 1u) + place.y) * n.x + place.x,
        (place.z * n.y + place.y) * n.x + place.x,
    );
}

fn faces_above(place: vec3<u32>) -> vec3<u32> {
    let n = level.cells;
    return faces_below(place) + vec3(1u, n.x, n.x * n.y);
}

// Where an invocation stands.
struct Invocation {
    @builtin(global_invocation_id) id: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
}
