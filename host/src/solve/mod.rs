//! `palpate solve`: JSON Lines in, JSON Lines out.
