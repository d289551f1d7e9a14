//! The balance of one edge, on made accounts.

use super::*;

fn line() -> LedgerLine {
    LedgerLine::of("a.b", "c.d")
}

/// A ledger in which consumer 1, by life, took from incarnation 0 of its producer: (life, last, total, lost).
fn taken(accounts: &[(u32, u64, u64, u64)]) -> Ledger {
    let mut ledger = Ledger::default();
    for (life, last, total, lost) in accounts {
        let r = JournalRef { first: *last, total: *total, lost: *lost, count: 1, ..JournalRef::default() };
        ledger.taken.insert((1, *life, 0, 0), r);
    }
    ledger
}

fn balance(ledger: &Ledger, sent: u64, pool_exhausted: u64) -> LedgerLine {
    let mut line = line();
    ledger.balance(&mut line, 1, 0, 0, sent, pool_exhausted);
    line
}

#[test]
fn all_received_balances() {
    let line = balance(&taken(&[(0, 9, 10, 0)]), 10, 0);
    assert!(line.balances() && line.received == 10, "{line:?}");
}

#[test]
fn gaps_are_overwritten_and_the_tail_is_left() {
    let line = balance(&taken(&[(0, 7, 5, 3)]), 10, 0);
    assert!(line.balances(), "{line:?}");
    assert_eq!((line.overwritten, line.left), (3, 2));
}

#[test]
fn what_was_sent_between_two_lives_of_the_consumer_is_down() {
    let line = balance(&taken(&[(0, 3, 4, 0), (1, 9, 3, 0)]), 10, 0);
    assert!(line.balances(), "{line:?}");
    assert_eq!((line.received, line.down), (7, 3));
}

#[test]
fn samples_without_memory_are_not_called_overwritten() {
    let line = balance(&taken(&[(0, 9, 8, 2)]), 10, 2);
    assert!(line.balances(), "{line:?}");
    assert_eq!((line.pool_exhausted, line.overwritten), (2, 0));
}

#[test]
fn a_sample_taken_twice_is_unexplained() {
    let line = balance(&taken(&[(0, 5, 6, 0), (1, 9, 6, 0)]), 10, 0);
    assert!(!line.balances(), "{line:?}");
}

#[test]
fn a_sample_taken_that_nobody_sent_is_unexplained() {
    let line = balance(&taken(&[(0, 9, 10, 0)]), 8, 0);
    assert!(!line.balances(), "{line:?}");
}
