//! A controller with GRBL 1.1.

use std::collections::VecDeque;

use super::{Protocol, SimulatedStage, StageFailure};

const STARTUP: &str = "\r\nGrbl 1.1h ['$' for help]\r\n";
const LOCKED: &str = "[MSG:'$H'|'$X' to unlock]\r\n";

/// Answers as GRBL's documentation says: a move is taken at once and done in its time, a dwell
/// when everything before it is done.
pub struct GrblEmulator {
    stage: SimulatedStage,
    line: Vec<u8>,
    waiting: VecDeque<String>,
    /// Moves that were taken and have not begun.
    queue: VecDeque<Vec<(usize, f64)>>,
    /// A dwell, or homing, is answered when nothing moves any more.
    owed: bool,
    held: bool,
    /// Locked: G-code is refused.
    locked: bool,
    /// After a limit switch nothing is answered at all until a reset.
    dead: bool,
    absolute: bool,
    reports: u32,
}

impl GrblEmulator {
    /// `stage`, its axes being X, Y and Z.
    pub fn new(stage: SimulatedStage) -> Self {
        Self {
            stage,
            line: Vec::new(),
            waiting: VecDeque::new(),
            queue: VecDeque::new(),
            owed: false,
            held: false,
            locked: false,
            dead: false,
            absolute: true,
            reports: 0,
        }
    }

    fn report(&mut self) -> String {
        let moving = self.stage.any_moving();
        let state = match (self.locked, self.held, moving) {
            (true, ..) => "Alarm",
            (_, true, true) => "Hold:1",
            (_, true, false) => "Hold:0",
            (_, _, true) => "Run",
            _ if !self.queue.is_empty() => "Run",
            _ => "Idle",
        };
        let at = |axis| self.stage.at(axis);
        let mut report = format!("<{state}|MPos:{:.3},{:.3},{:.3}|FS:0,0", at(0), at(1), at(2));
        if self.reports.is_multiple_of(10) {
            report += "|WCO:0.000,0.000,0.000";
        }
        self.reports += 1;
        report + ">\r\n"
    }

    fn reset(&mut self) -> String {
        let lost = self.stage.any_moving();
        self.stage.rest();
        self.stage.mend();
        self.waiting.clear();
        self.queue.clear();
        self.line.clear();
        (self.owed, self.held, self.dead) = (false, false, false);
        self.reports = 0;
        let mut text = String::new();
        if lost {
            self.locked = true;
            text += "ALARM:3\r\n";
        }
        text += STARTUP;
        if self.locked {
            text += LOCKED;
        }
        text
    }

    /// Carries out a line; `None` if its answer comes later.
    fn execute(&mut self, line: &str) -> Option<String> {
        let ok = Some("ok\r\n".to_owned());
        let error = |n: u16| Some(format!("error:{n}\r\n"));
        match line {
            "" => return ok,
            "$$" => {
                let settings = ["0=10", "10=1", "13=0", "22=1", "110=500.000", "130=200.000"];
                let text: String = settings.iter().map(|s| format!("${s}\r\n")).collect();
                return Some(text + "ok\r\n");
            }
            "$X" => {
                self.locked = false;
                return Some("[MSG:Caution: Unlocked]\r\nok\r\n".to_owned());
            }
            "$H" => {
                self.locked = false;
                for axis in 0..self.stage.count() {
                    self.stage.go(axis, 0.0);
                }
                self.owed = true;
                return None;
            }
            _ if line.starts_with('$') => return error(3),
            _ if self.locked => return error(9),
            _ => {}
        }
        let Some(words) = words(line) else { return error(1) };
        let mut to = Vec::new();
        for &(letter, value) in &words {
            match (letter, value) {
                ('G', 90.0) => self.absolute = true,
                ('G', 91.0) => self.absolute = false,
                ('G', 0.0 | 1.0 | 4.0 | 21.0 | 53.0 | 54.0) | ('F' | 'P', _) => {}
                ('X' | 'Y' | 'Z', value) => {
                    let axis = usize::from(letter as u8 - b'X');
                    to.push((
                        axis,
                        if self.absolute { value } else { self.stage.at(axis) + value },
                    ));
                }
                _ => return error(20),
            }
        }
        if words.contains(&('G', 4.0)) {
            self.owed = true;
            return None;
        }
        if !to.is_empty() {
            self.queue.push_back(to);
        }
        ok
    }
}

/// Letters and numbers.
fn words(line: &str) -> Option<Vec<(char, f64)>> {
    let line: String = line.chars().filter(|c| !c.is_whitespace()).collect();
    let mut words = Vec::new();
    let mut rest = line.as_str();
    while let Some(letter) = rest.chars().next() {
        if !letter.is_ascii_alphabetic() {
            return None;
        }
        rest = rest.get(1..)?;
        let end = rest.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(rest.len());
        let (number, tail) = rest.split_at_checked(end)?;
        words.push((letter.to_ascii_uppercase(), number.parse().ok()?));
        rest = tail;
    }
    Some(words)
}

impl Protocol for GrblEmulator {
    /// The board restarts when its port is opened; with homing switched on it is locked then.
    fn connected(&mut self) -> Vec<u8> {
        self.locked = true;
        self.reset().into_bytes()
    }

    fn receive(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut answers = Vec::new();
        for &byte in bytes {
            match byte {
                0x18 => answers.push(self.reset().into_bytes()),
                _ if self.dead => {}
                b'?' => answers.push(self.report().into_bytes()),
                b'!' => {
                    // What is left of a held move is lost with the reset that ends the hold.
                    self.held = self.stage.any_moving();
                    self.stage.rest();
                }
                b'~' => self.held = false,
                b'\r' | b'\n' => {
                    let line = std::mem::take(&mut self.line);
                    self.waiting.push_back(String::from_utf8_lossy(&line).trim().to_owned());
                }
                _ => self.line.push(byte),
            }
        }
        let news = self.tick();
        answers.push(news);
        answers
    }

    fn tick(&mut self) -> Vec<u8> {
        let mut text = String::new();
        if self.stage.failed() == Some(StageFailure::HitLimit) && !self.dead {
            (self.dead, self.locked, self.owed) = (true, true, false);
            text += "ALARM:1\r\n[MSG:Reset to continue]\r\n";
        }
        if self.dead || self.held {
            return text.into_bytes();
        }
        if !self.stage.any_moving() {
            match self.queue.pop_front() {
                Some(to) => to.into_iter().for_each(|(axis, to)| self.stage.go(axis, to)),
                None if self.owed => {
                    self.owed = false;
                    text += "ok\r\n";
                }
                None => {}
            }
        }
        while !self.owed {
            let Some(line) = self.waiting.pop_front() else { break };
            text += &self.execute(&line).unwrap_or_default();
        }
        text.into_bytes()
    }
}
