"""Everything that is simulated, and said to be.

`example` is the machine of `thermap demo`, after the chapter, whose temperatures move. It has the
service's own geometry and tables. `undeclared` makes machines, readings and measurement campaigns
with an effect that nobody declared, and the truth behind them; it judges the service, and shares
no code with it.
"""
