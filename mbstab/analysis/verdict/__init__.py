"""The verdict: facts about a linearized motion, and the rule that says what follows from them."""
