"""One pair: who comes, how they walk, what the ego does; both arms, step by step."""
