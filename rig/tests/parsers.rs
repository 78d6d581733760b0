//! Parsers of what devices send, fed with what no device would.

use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Lines that devices do send: mutations of them get further than noise.
const TRANSCRIPTS: [&[u8]; 36] = [
    b"PJLINK 0",
    b"PJLINK 1 498e4a67",
    b"PJLINK ERRA",
    b"%1POWR=3",
    b"%1POWR=ERR3",
    b"%1LAMP=1234 1 77 0",
    b"1234 1 77 0",
    b"012000",
    b"31",
    b"P",
    b"F",
    b"OK1",
    b"INFO1\rOK1012340600C010",
    b"OK101230600C01INFO4",
    b"101230600C01",
    b"PWR=01",
    b"PWR=05\r",
    b"LAMP=1234",
    b"ERR",
    b"ERR=0E",
    b"IMEVENT=0001 02 00000002 00000000 T1 F1",
    b">*pow=?#",
    b"*POW=ON#",
    b"*LTIM=1234#",
    b"Block item",
    b"Illegal format",
    b"<Idle|MPos:0.000,0.000,0.000|FS:0.0,0>",
    b"<Hold:0|WPos:-2.500,0.000,11.000|FS:500,8000|WCO:1.0,2.0,3.0|Pn:PZ>",
    b"error:20",
    b"ALARM:1",
    b"$110=500.000",
    b"Grbl 1.1h ['$' for help]",
    b"@01 0 OK BUSY -- 5.5",
    b"@01 1 07 RJ IDLE WR BADDATA",
    b"!01 1 IDLE --",
    b"#01 0 a remark:2C",
];

fn any_bytes(rng: &mut ChaCha8Rng) -> Vec<u8> {
    if rng.random_range(0..4) == 0 {
        let mut noise = vec![0; rng.random_range(0..64)];
        rng.fill_bytes(&mut noise);
        return noise;
    }
    let mut bytes = TRANSCRIPTS[rng.random_range(0..TRANSCRIPTS.len())].to_vec();
    for _ in 0..rng.random_range(1..6) {
        let at = rng.random_range(0..=bytes.len());
        match rng.random_range(0..6) {
            0 if at < bytes.len() => bytes[at] = rng.random(),
            1 => bytes.insert(at, rng.random()),
            2 if at < bytes.len() => drop(bytes.remove(at)),
            3 => bytes.truncate(at),
            4 => bytes.insert(at, b"0123456789-+.,:|=#*@ "[rng.random_range(0..21)]),
            _ => {
                let other = TRANSCRIPTS[rng.random_range(0..TRANSCRIPTS.len())];
                bytes.extend(&other[rng.random_range(0..other.len())..]);
            }
        }
    }
    bytes
}

/// `DIAPHANE_FUZZ_CASES` sets how many; a million take a few seconds in release.
#[test]
fn any_bytes_are_answered() {
    const SEED: u64 = 20_261_122;
    let cases = std::env::var("DIAPHANE_FUZZ_CASES").ok().and_then(|n| n.parse().ok());
    let cases: u64 = cases.unwrap_or(20_000);
    for (name, parser) in rig::devices::parsers() {
        let mut rng = ChaCha8Rng::seed_from_u64(SEED);
        for case in 0..cases {
            let bytes = any_bytes(&mut rng);
            let outcome = std::panic::catch_unwind(|| parser(&bytes));
            assert!(outcome.is_ok(), "{name}, case {case}, seed {SEED}: {}", bytes.escape_ascii());
        }
        println!("{name}: {cases} cases, seed {SEED}");
    }
}

#[test]
fn the_transcripts_themselves_are_understood() {
    use rig::devices::{benq, epson, grbl, optoma, pjlink, zaber};
    for line in TRANSCRIPTS {
        let understood = pjlink::parse_greeting(line).is_ok()
            || pjlink::parse_reply(line, b"POWR").is_ok()
            || pjlink::parse_reply(line, b"LAMP").is_ok()
            || pjlink::parse_errors(line).is_ok()
            || pjlink::parse_mute(line).is_ok()
            || pjlink::parse_lamps(line).is_ok()
            || optoma::parse_messages(line).is_ok()
            || optoma::parse_information(line).is_ok()
            || epson::parse_reply(line).is_ok()
            || benq::parse_line(line, "*pow=?#").is_ok()
            || grbl::parse_message(line).is_ok()
            || zaber::parse_line(line).is_ok();
        assert!(understood, "{}", line.escape_ascii());
    }
}
