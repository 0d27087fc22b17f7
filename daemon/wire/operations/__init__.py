"""Operations of the control socket: one row each, with its request and its reply; `table` holds them all."""
