// The walk of most kernels: an invocation takes four lanes of a column of cells and goes through
// `planes` of them. The kernel that follows says what it does with a cell and what of it is to be
// summed (0 where nothing is): visit(place, cell, i), with its fields at position i.

fn walk(id: vec3<u32>) -> vec4<f32> {
    let column = vec2(id.x / level.quads, id.y);
    var sum = vec4(0.0);
    if all(column < level.cells.xy) {
        let last = min((id.z + 1u) * level.planes, level.cells.z);
        for (var z = id.z * level.planes; z < last; z++) {
            let place = vec3(column, z);
            let cell = cell_at(place);
            sum += visit(place, cell, cell * level.quads + id.x % level.quads);
        }
    }
    return sum;
}
