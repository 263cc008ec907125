"""The field page: a campaign's front desk in a browser, on a phone beside the beds or on a laptop.

`server` joins the parts: `conductor` has a preview or a recording shown, `hub` passes it to all viewers,
`answers` carries out what viewers ask for, `keys` and `checks` decide who may.
"""
